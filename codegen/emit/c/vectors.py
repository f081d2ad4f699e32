"""Vector types of a scalar type for the templates, by instruction set: numbers of lanes, transposes, partial rows."""

from __future__ import annotations

from collections.abc import Callable

from ..target import InstructionSet, Scalar
from . import C

Lines = Callable[[int], list[str]]
"""Returns lines for vectors of a given number of lanes."""


def lanes(scalar: Scalar) -> list[int]:
    """Number of scalars in a vector, by instruction set."""
    return [s.bytes // scalar.bytes if scalar.integer else 1 for s in C.vectors]


def most_lanes(scalar: Scalar) -> int:
    """Number of scalars in the widest vector."""
    return max(lanes(scalar))


def by_set(scalar: Scalar, lines: Lines) -> list[str]:
    """Preprocessor lines that select by instruction set; sets with equal lines are combined."""
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
    """How vectors of states are loaded from 16-byte parts of rows, and the exchange of their entries."""
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


def part_of_row(scalar: Scalar) -> dict[str, list[str]]:
    """Load and store of the first n entries of a row in such a part, for n less than its size."""
    some = range(1, 16 // scalar.bytes - 1)
    return {
        "first_entries": ["row[0]", *(f"n > {i} ? row[{i}] : {scalar.literal('0.0')}" for i in some)],
        "later_entries": [f"if (n > {i}) row[{i}] = x[{i}];" for i in some],
    }


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
        **part_of_row(scalar),
    }


__all__ = ["columns", "most_lanes", "words"]
