"""What templates say of vectors of a scalar type, from the instruction sets of the target: lanes, squares, rows in part."""

from __future__ import annotations

from collections.abc import Callable

from ..target import InstructionSet, Scalar
from . import C

Lines = Callable[[int], list[str]]
"""Lines for vectors of a given number of lanes."""


def lanes(scalar: Scalar) -> list[int]:
    """How many scalars the vectors of each instruction set hold."""
    return [s.bytes // scalar.bytes if scalar.integer else 1 for s in C.vectors]


def most_lanes(scalar: Scalar) -> int:
    """The same of the widest."""
    return max(lanes(scalar))


def by_set(scalar: Scalar, lines: Lines) -> list[str]:
    """Lines that the preprocessor chooses by instruction set; sets whose lines are the same stand together."""
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
    """How many lanes the vectors over eight and over two directions have."""
    return by_set(scalar, lambda n: [f"enum {{ VECTOR_8 = {min(n, 8)}, VECTOR_2 = {min(n, 2)} }};"])


def columns(scalar: Scalar, width: int, group: int) -> list[str]:
    """How many lanes the vectors over columns of matrices have."""
    return by_set(scalar, lambda n: [f"enum {{ VECTOR_{width} = {min(n, group)} }};"])


def states(scalar: Scalar) -> list[str]:
    """How many states are worked on at once."""
    return by_set(scalar, lambda n: [f"enum {{ STATES = {n} }};"])


def parts(scalar: Scalar) -> list[str]:
    """How vectors of states are made of parts of sixteen bytes, each of one row, and what exchanges the entries of these."""
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
    """The first n entries of a row as such a part, where n is less than it holds, and what stores them."""
    some = range(1, 16 // scalar.bytes - 1)
    return {
        "first_entries": ["row[0]", *(f"n > {i} ? row[{i}] : {scalar.literal('0.0')}" for i in some)],
        "later_entries": [f"if (n > {i}) row[{i}] = x[{i}];" for i in some],
    }


def words(scalar: Scalar) -> dict[str, object]:
    """What templates call of a scalar type, and of its vectors."""
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
