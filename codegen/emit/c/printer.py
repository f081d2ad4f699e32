"""Prints expressions of statements in C."""

from __future__ import annotations

from ..printer import Printer
from . import OF_THE_LIBRARY, library_function


class CPrinter(Printer):
    """Prints expressions in C."""

    def spelled(self, function: str) -> str:
        return library_function(super().spelled(function), self.scalar)

    def library(self) -> list[str]:
        """Names of C library functions that the printed text calls, in double precision; sines have further names."""
        printed = {self.target.function(f) for f in self.called} | {"sin", "cos"}
        return [f for f in OF_THE_LIBRARY if f in printed]

    def sign(self, x: str) -> str:
        zero = self.scalar.literal("0.0")
        return f"(TRUTH({x} > {zero}) - TRUTH({x} < {zero}))"

    def at_least(self, a: str, b: str) -> str:
        return f"TRUTH({a} >= {b})"

    def turned(self, angle: str, mode: str) -> str:
        return f"TURNED({mode}, {angle})"

    def held(self, name: str, mode: str, arguments: list[str], free: str) -> str:
        number = self.scalar.literal
        one, zero, half, quarter, two = map(number, ("1.0", "0.0", "0.5", "0.25", "2.0"))
        match name:
            case "HeldAtLeast":
                above, below = one, zero
            case "HeldSign":
                above, below = one, f"-{one}"
            case "HeldFloor":
                above, below = (
                    f"({c}{two}*FLOOR({half}*({arguments[0]}) {s} {quarter}))"
                    for c, s in (("", "+"), (f"{one} + ", "-"))
                )
            case "HeldAngle":
                above, below = (f"ANGLE_{side}({arguments[1]}, {free})" for side in ("ABOVE", "BELOW"))
            case "HeldAbsolute":
                above, below = arguments[0], f"-({arguments[0]})"
            case "HeldMaximum":
                above, below = arguments
            case _:
                below, above = arguments
        return f"HELD({mode}, {above}, {below}, {free})"
