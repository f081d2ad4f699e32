"""Vector types of a scalar type for the templates, by instruction set: numbers of lanes, transposes, partial rows."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from ..target import InstructionSet, Scalar
from . import C

Lines = Callable[[int], list[str]]
"""A function that returns lines for vectors with a given number of lanes."""


def lanes(scalar: Scalar) -> list[int]:
    """Number of scalars in a vector, by instruction set."""
    return [s.bytes // scalar.bytes if scalar.integer else 1 for s in C.vectors]


def most_lanes(scalar: Scalar) -> int:
    """Number of scalars in the widest vector."""
    return max(lanes(scalar))


def by_set(scalar: Scalar, lines: Lines) -> list[str]:
    """Preprocessor lines that select lines by instruction set; sets with equal lines are combined."""
    found: list[tuple[InstructionSet, list[str]]] = []
    for of, n in zip(C.vectors, lanes(scalar), strict=True):
        if found and found[-1][1] == lines(n):
            found.pop()
        found.append((of, lines(n)))
    if len(found) == 1:
        return found[0][1]
    result = []
    for i, (of, of_set) in enumerate(found):
        result.append(f"#{'el' if i else ''}if defined({of.macro})" if of.macro else "#else")
        result += of_set
    return [*result, "#endif"]


def directions(scalar: Scalar) -> list[str]:
    """Numbers of lanes for eight and for two directions."""
    return by_set(scalar, lambda n: [f"enum {{ VECTOR_8 = {min(n, 8)}, VECTOR_2 = {min(n, 2)} }};"])


def columns(scalar: Scalar, width: int, group: int) -> list[str]:
    """Number of lanes for columns of matrices."""
    return by_set(scalar, lambda n: [f"enum {{ VECTOR_{width} = {min(n, group)} }};"])


def states(scalar: Scalar) -> list[str]:
    """Number of states that are processed at once."""
    return by_set(scalar, lambda n: [f"enum {{ STATES = {n} }};"])


def parts(scalar: Scalar) -> list[str]:
    """Lines that load 16-byte parts of the rows of several states, and transpose them to vectors of states."""
    if not scalar.integer:
        return []
    part = 16 // scalar.bytes

    def of(n: int) -> list[str]:
        first, *others = (f"(__m128)PART_OF_ROW({i})" for i in range(n // part))
        joined = (
            f"_mm256_insertf128_ps(_mm256_castps128_ps256({first}), {others[0]}, 1)" if others else "PART_OF_ROW(0)"
        )
        for i, other in enumerate(others[1:], 2):
            joined = f"_mm512_insertf32x4({f'_mm512_castps256_ps512({joined})' if i == 2 else joined}, {other}, {i})"
        halves = [
            ", ".join(f"{i}, {n + i}" for i in range(n) if (i % part >= part // 2) == high) for high in (False, True)
        ]
        return [f"#define JOINED {joined}", f"#define LOW {halves[0]}", f"#define HIGH {halves[1]}"]

    return by_set(scalar, of)


def short(scalar: Scalar, sizes: Iterable[int]) -> list[int]:
    """The sizes of rows of at least two entries that take less than sixteen bytes."""
    return sorted({n for n in sizes if 1 < n < 16 // scalar.bytes}) if scalar.integer else []


def short_rows(scalar: Scalar, sizes: Iterable[int]) -> list[str]:
    """The functions that copy rows with these numbers of entries, stored without gaps, to vectors of states and back."""
    comment = ["/* Contiguous rows with fewer entries than a part fill whole vectors. */"] if sizes else []
    return comment + by_set(
        scalar, lambda lanes: [line for n in sizes for line in (*_take(n, lanes), *_give(n, lanes))]
    )


def _take(n: int, lanes: int) -> list[str]:
    """Lines that turn n vectors in memory into n vectors of states: lane i of state vector c is entry n*i + c."""
    body = [f"const states {', '.join(f'x{s} = at[{s}]' for s in range(n))};"]
    for c in range(n):
        order = [n * i + c for i in range(lanes)]
        if lanes % n == 0:  # here n is 2
            body += [f"to[{c}*apart] = {_chosen('x0', 'x1', order)};"]
            continue
        # the entries c of all states are in different lanes: first blend the vectors, then put the lanes in order
        source = [next(s for s in range(n) if (s * lanes + i) % n == c) for i in range(lanes)]
        body += _blended(f"y{c}", source, n)
        body += [f"to[{c}*apart] = {_chosen(f'y{c}', f'y{c}', [entry % lanes for entry in order])};"]
    return _function(f"take_{n}(states *to, int apart, const states_in_memory *at)", body)


def _give(n: int, lanes: int) -> list[str]:
    """Lines that turn n vectors of states into n vectors in memory: the inverse of `_take`."""
    body = []
    if lanes % n == 0:
        body += [f"const states {', '.join(f'x{c} = of[{c}*apart]' for c in range(n))};"]
        for s in range(n):
            order = [j % n * lanes + j // n for j in range(s * lanes, (s + 1) * lanes)]
            body += [f"at[{s}] = {_chosen('x0', 'x1', order)};"]
        return _function(f"give_{n}(states_in_memory *at, const states *of, int apart)", body)
    for c in range(n):
        place = {(n * i + c) % lanes: i for i in range(lanes)}
        order = [place[i] for i in range(lanes)]
        body += [f"const states x{c} = {_chosen(f'of[{c}*apart]', f'of[{c}*apart]', order)};"]
    for s in range(n):
        body += [*_blended(f"y{s}", [(s * lanes + i) % n for i in range(lanes)], n), f"at[{s}] = y{s};"]
    return _function(f"give_{n}(states_in_memory *at, const states *of, int apart)", body)


def _function(head: str, body: list[str]) -> list[str]:
    return [f"static inline void {head}", "{", *(f"    {line}" for line in body), "}", ""]


def _chosen(a: str, b: str, order: list[int]) -> str:
    """A vector whose lanes are selected from two vectors; the lanes of both are numbered consecutively."""
    return f"CHOSEN({a}, {b}, {', '.join(map(str, order))})"


def _blended(name: str, source: list[int], n: int) -> list[str]:
    """Lines that select lanes: lane i of the vector `name` is lane i of ``x0``, ``x1``, ..., as ``source[i]`` says."""
    lines: list[str] = []
    for k in range(1, n):
        order = [len(source) + i if s == k else i for i, s in enumerate(source)]
        lines.append(f"{'' if lines else 'states '}{name} = {_chosen(name if lines else 'x0', f'x{k}', order)};")
    return lines


def words(scalar: Scalar) -> dict[str, object]:
    """Names that templates use for a scalar type and its vectors."""
    return {
        "real": scalar.word,
        "reals": scalar.words,
        "F": scalar.suffix,
        "bytes": scalar.bytes,
        "integer": scalar.integer or "int",
        "plain": [] if scalar.integer else ["#ifndef ORDERNM_PLAIN_C", "#define ORDERNM_PLAIN_C", "#endif"],
        "per_line": scalar.per_line,
        "most_lanes": most_lanes(scalar),
        "vector_lanes": directions(scalar),
        "state_lanes": states(scalar),
        "parts": parts(scalar),
        "exchanges": [2, 1][2 - 8 // scalar.bytes :] if scalar.integer else [],
    }


__all__ = ["columns", "most_lanes", "short", "short_rows", "words"]
