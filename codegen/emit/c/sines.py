"""Coefficients of the sines and cosines that generated C computes in vectors, by scalar type."""

from __future__ import annotations

from collections.abc import Sequence

from ...records import dataclass
from ..target import Scalar


@dataclass(frozen=True, slots=True)
class Sines:
    """Reduction of angles to [-pi/4, pi/4], and the polynomials there.

    Attributes
    ----------
    quarter_turns : str
        2/pi.
    shift : str
        Number that is added to round to an integer; the integer is then in the last bits of the sum.
    parts : tuple of str
        Summands of pi/2; products of the first two with a number of quarter turns are exact.
    limit, exact : str
        Angle above which the C library is called; number of quarter turns up to which the products of `parts` are exact.
    sine, cosine : tuple of str
        Coefficients of powers of the square, after the terms ``r`` and ``1 - r^2/2``.
    accuracy : str
        Accuracy of the results, in words.
    sign : int
        Number of bits by which the bit of half turns is shifted to become the sign bit.
    """

    quarter_turns: str
    shift: str
    parts: tuple[str, str, str]
    limit: str
    exact: int
    sine: tuple[str, ...]
    cosine: tuple[str, ...]
    accuracy: str
    sign: int


SINES = {
    "float64": Sines(
        "0.6366197723675814", "6755399441055744.0",
        ("1.5707963267341256", "6.077100506303966e-11", "2.0222662487959506e-21"), "1.0e6", 20,
        ("-0.16666666666666632", "0.008333333333322427", "-0.0001984126982981922", "2.755731369604923e-06",
         "-2.5050758787269184e-08", "1.589683597668156e-10"),
        ("0.0416666666666666", "-0.0013888888888874142", "2.4801587289494277e-05", "-2.7557314355980973e-07",
         "2.087572378888479e-09", "-1.1359675470911669e-11"),
        "below one unit in the last place", 62,
    ),
    "float32": Sines(
        "0.63661975", "12582912.0", ("1.5703125", "0.0004837513", "7.54979e-08"), "1.0e4", 13,
        ("-0.16666664", "0.008332747", "-0.00019587639"), ("0.041666664", "-0.0013888301", "2.454769e-05"),
        "below one unit in the last place of one", 30,
    ),
}  # fmt: skip


def horner(coefficients: Sequence[str], scalar: Scalar) -> list[str]:
    """A polynomial in z, in lines of three coefficients."""
    last = len(coefficients) - 1
    terms = [
        ("" if i == 0 else " + z*" if i == last else " + z*(") + scalar.literal(c) for i, c in enumerate(coefficients)
    ]
    text = ["".join(terms[i : i + 3]).strip() for i in range(0, len(terms), 3)]
    return [*text[:-1], text[-1] + ")" * (last - 1)]


def words(scalar: Scalar) -> dict[str, object]:
    """Constants for the templates of sines and cosines."""
    of, number = SINES.get(scalar.name, SINES["float64"]), scalar.literal  # unused for other types
    return {
        "quarter_turns": number(of.quarter_turns), "shift": number(of.shift), "parts": [*map(number, of.parts)],
        "limit": number(of.limit), "exact": of.exact, "accuracy": of.accuracy, "sign": of.sign,
        "sine_tail": horner(of.sine, scalar), "cosine_tail": horner(of.cosine, scalar),
    }  # fmt: skip


__all__ = ["words"]
