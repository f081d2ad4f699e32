"""Errors of symbolic computations."""

from __future__ import annotations


class SymbolicError(ValueError):
    """Raised for a request that cannot be met, or a part of a model without a formula that sympy can represent."""


class TooLargeError(SymbolicError):
    """Raised if equations have more terms than allowed."""


class TooManyProductsError(ArithmeticError):
    """Raised if polynomials need more products of terms than allowed."""


__all__ = ["SymbolicError", "TooLargeError", "TooManyProductsError"]
