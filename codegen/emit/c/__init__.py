"""The C target: C11, with the vector extensions of GNU C where available, in double or single precision."""

from __future__ import annotations

from ...program.limits import DOUBLE, Limits
from ..target import InstructionSet, Scalar, Target, spelled

FLOAT64 = Scalar("float64", "double", "doubles", 8, DOUBLE, 2.0**1023 * (2 - 2.0**-52), integer="long long")
FLOAT32 = Scalar(
    "float32",
    "float",
    "floats",
    4,
    Limits(2.0**-23, 2.0**-126),
    2.0**127 * (2 - 2.0**-23),
    "f",
    "int",
    1e-3,
    moves=False,
)

C = Target(
    "c",
    (FLOAT64, FLOAT32),
    {
        **spelled("c"), "pow": "pow", "Power": "pow",
        "Floor": "FLOOR", "Choice": "CHOICE", "Vanishing": "VANISHING", "Along": "DIRECTIONS(ALONG)",
    },
    frozenset(
        "auto break case char const continue default do double else enum extern float for goto if inline int long register "
        "restrict return short signed sizeof static struct switch typedef union unsigned void volatile while unit element "
        "call asm typeof typeof_unqual alignas alignof bool constexpr false nullptr static_assert thread_local true linux "
        "unix i386".split()
    ),
    (InstructionSet("__AVX512F__", 64), InstructionSet("__AVX__", 32), InstructionSet("", 16)),
)  # fmt: skip
"""Reserved words of C up to C23, and names that GNU C defines."""

OF_THE_LIBRARY = tuple(dict.fromkeys(f for f in C.functions.values() if f.islower()))
"""Functions of the C library that generated code calls; for types other than double a suffix is appended."""


def library_function(name: str, scalar: Scalar) -> str:
    """Name of a function of the C library for a scalar type."""
    return name + scalar.suffix if name in (*OF_THE_LIBRARY, "floor") else name


__all__ = ["FLOAT32", "FLOAT64", "OF_THE_LIBRARY", "C", "library_function"]
