"""What `Solver.jacobians` returns."""

from __future__ import annotations

from dataclasses import dataclass

from .arrays import Array


@dataclass(slots=True, eq=False, repr=False)
class Jacobians:
    """Partial derivatives of udot.

    Attributes
    ----------
    q : (..., nu, nq)
    u : (..., nu, nu)
    p : (..., nu, np)
    inputs : (..., nu, ninputs)
    t : (..., nu)
    """

    q: Array
    u: Array
    p: Array
    inputs: Array
    t: Array

    def __repr__(self) -> str:
        shapes = ", ".join(f"{n} {getattr(self, n).shape}" for n in JACOBIANS)
        return f"<Jacobians of udot: {shapes}>"


JACOBIANS = ("q", "u", "p", "inputs", "t")
"""What udot is differentiated in, in the order of `Jacobians`."""
