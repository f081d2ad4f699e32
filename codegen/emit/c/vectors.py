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


def exchanges(scalar: Scalar) -> list[str]:
    """Lines that exchange rows and columns of a square of states: parts of it, then parts of these."""

    def of(n: int) -> list[str]:
        found = []
        w = 1
        while w < n:
            low = ", ".join(str(n + i - w if i & w else i) for i in range(n))
            high = ", ".join(str(n + i if i & w else i + w) for i in range(n))
            found.append(f"    EXCHANGE({w}, LIST({low}), LIST({high}))")
            w *= 2
        return found

    return by_set(scalar, of)


def partly(scalar: Scalar, stores: bool) -> list[str]:
    """Lines that load the first n entries of a row to a vector, or store them."""
    if not scalar.integer:
        return []
    kind, zero = {8: "pd", 4: "ps"}[scalar.bytes], scalar.literal("0.0")

    def of(n: int) -> list[str]:
        if n * scalar.bytes == 64:
            mask = f"(__mmask{n})((1 << n) - 1)"
            if stores:
                return [f"        _mm512_mask_storeu_{kind}(row, {mask}, x);"]
            return [f"    return _mm512_maskz_loadu_{kind}({mask}, row);"]
        if n * scalar.bytes == 32:
            known = ", ".join(f"n > {i} ? -1 : 0" for i in range(1, n - 1))
            mask = f"_mm256_setr_epi{8 * scalar.bytes}{'x' if scalar.bytes == 8 else ''}(-1, {known}, 0)"
            if stores:
                return [f"        _mm256_maskstore_{kind}(row, {mask}, x);"]
            return [f"    return _mm256_maskload_{kind}(row, {mask});"]
        if stores:
            whole = "row[0] = x[0];" if n == 2 else "for (int l = 0; l < n; ++l) row[l] = x[l];"
            return [f"        {whole}"]
        entries = ", ".join("row[0]" if i == 0 else f"n > {i} ? row[{i}] : {zero}" for i in range(n - 1))
        return [f"    return (states){{{entries}}};"]

    return by_set(scalar, of)


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
        "exchanges": exchanges(scalar),
        "load_partly": partly(scalar, False),
        "store_partly": partly(scalar, True),
    }


__all__ = ["columns", "most_lanes", "words"]
