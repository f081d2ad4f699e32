"""Prints expressions of statements in NumPy."""

from __future__ import annotations

from ..printer import Printer


class NumpyPrinter(Printer):
    """Prints expressions in NumPy."""

    def sign(self, x: str) -> str:
        return f"{self.spelled('Sign')}({x})"

    def at_least(self, a: str, b: str) -> str:
        return f"np.where({a} >= {b}, 1.0, 0.0)"

    def turned(self, angle: str, mode: str) -> str:
        return angle

    def held(self, name: str, mode: str, arguments: list[str], free: str) -> str:
        """The function without its mode, since only integrators set modes, and they do not call NumPy functions."""
        return free
