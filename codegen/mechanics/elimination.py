"""Elimination from symmetric systems and back substitution: one algorithm for trees and loops. Eqs. 44-47, 53.

Unknown accelerations a require the force ``Q a + p``. A degree of freedom adds its acceleration times a column s to a,
and the force along s is given: ``s . (Q (a + s udot) + p) = tau``. With ``U = Q s`` and ``D = s . U`` that is

    udot = r / D - G . a,    G = U / D,    r = tau - s . p,

and for the other unknowns ``Q - G U^T`` and ``p + G r`` remain: no inertia along s, and the force tau.

A reflected inertia `rotor` is added to D and to nothing else. Then ``s . G`` is ``1 - rotor/D``. Along s, there remain
the inertia ``rotor G`` and the force ``tau - rotor r/D``. Neither is a difference of large terms.

When a link is eliminated, the unknowns are the six acceleration components of the link and of each partner; the columns are those
of its joint. When a region is eliminated, the unknowns are the accelerations of its sources, of its base if this carries the
region, and of the partners. The column of a source has one entry, for the source itself.
"""

from __future__ import annotations

from collections.abc import Sequence

from ..program.block import ANY, Scope
from ..program.field import ScalarField
from ..program.limits import limits
from ..program.scalar import Matrix, Value, Vector
from ..program.store import Store
from ..records import dataclass
from . import fields
from .joints import Column
from .spatial import SIX, is_zero
from .stores import ME, PIVOT, REGION
from .structure.kinds import LinkKind, RegionKind

SMALL = 2e-15
"""Smallest pivot relative to the inertia along the column; a smaller pivot means that nothing outboard has inertia
about the joint. This margin, like all margins in `mechanics`, is for double precision."""


class ZeroPivotError(ValueError):
    """Raised if no body outboard of a joint has inertia about it."""

    def __init__(self, kind: LinkKind | RegionKind):
        super().__init__("nothing outboard of the joint has inertia about it")
        self.kind = kind


@dataclass(frozen=True)
class PivotFields:
    """Fields that store the results of eliminations. Back substitution and solutions for other right sides read them.

    Attributes
    ----------
    store : Store
    inverse, right_side : ScalarField
        ``1 / D`` and ``r / D``, by degree of freedom.
    gain : ScalarField
        ``G``, by degree of freedom and unknown.
    entry, force, moving : str
        Names in generated code for entries of Q, of p, and of p in sweeps over directions.
    """

    store: Store
    inverse: ScalarField
    right_side: ScalarField
    gain: ScalarField
    entry: str
    force: str
    moving: str


OF_FREEDOMS = PivotFields(ME, fields.inverse_pivot, fields.right_side, fields.gain, "A", "p", "P")
OF_SOURCES = PivotFields(
    REGION, fields.source_inverse_pivot, fields.source_right_side, fields.source_gain, "Q", "g", "g"
)


@dataclass(slots=True)
class SymmetricSystem:
    """The symmetric system of forces ``Q a + p`` for unknown accelerations a.

    Attributes
    ----------
    x : Scope
    kind : LinkKind or RegionKind
        The kind whose degrees of freedom are eliminated.
    Q : Matrix
        Symmetric; its entries have names.
    p : Vector
    kept : PivotFields
    labels : sequence of str
        Labels of the unknowns in names of the generated code.
    """

    x: Scope
    kind: LinkKind | RegionKind
    Q: Matrix
    p: Vector
    kept: PivotFields
    labels: Sequence[str]

    def eliminate(
        self, j: int, s: Column, tau: Value, whole: Value, left: range | None = None, rotor: Value = 0
    ) -> None:
        """Eliminate a degree of freedom, and store its pivot, right side and gains.

        Parameters
        ----------
        j : int
            Number of the degree of freedom in the stored fields.
        s : Column
            Change of the unknowns per unit acceleration.
        tau : value
            Force along the degree of freedom.
        whole : value
            Inertia along the degree of freedom, with which the pivot is compared.
        left : range, optional
            Unknowns that are still needed; all by default.
        rotor : value, optional
            Reflected inertia of the degree of freedom's rotor.

        Raises
        ------
        ZeroPivotError
            The pivot is zero in every state.
        """
        let, Q, p, kept = self.x.let, self.Q, self.p, self.kept
        unknowns = range(len(p))
        left = unknowns if left is None else left
        U = [let("U", s.along(row), "Eq. 46") for row in Q]
        moved, geared = s.along(U), not is_zero(rotor)
        D = self._pivot(let("D", moved + rotor if geared else moved, "Eq. 46"))
        inverse = let("Dinv", 1 / D, "Eq. 47")
        r = let("r", tau - s.along(p), "Eq. 53")
        bound = let("bound", self.x.number(limits().rounding(SMALL)) * whole, "zero pivot")
        self.x.set_entry(PIVOT, j, D - bound)
        self.x.store(kept.store, kept.inverse(j), inverse)
        driven = let("rD", r * inverse, "Eq. 53")
        self.x.store(kept.store, kept.right_side(j), driven)
        G = [0 if i == s.lead else let(f"G{self.labels[i]}", U[i] * inverse, "Eq. 46") for i in unknowns]
        if geared:
            G[s.lead] = let("G", moved * inverse, "Eq. 46")  # s . G, which is 1 without a rotor
        for i in unknowns:
            self.x.store(kept.store, kept.gain(j, i), G[i])
        others = [i for i in left if i != s.lead]
        for n, i in enumerate(others):
            for k in others[n:]:
                name = f"{kept.entry}{self.labels[i]}{self.labels[k]}"
                Q[i][k] = Q[k][i] = let(name, Q[i][k] - G[i] * U[k], "Eq. 44")
        for i in others:
            p[i] = let(f"{kept.force}{self.labels[i]}", p[i] + G[i] * r, "Eq. 45")
        if s.lead in left:
            # without a rotor s . Q = 0 remains, so the leading row follows from the others; it is 0 if s has one entry
            for k in (*others, s.lead):
                name = f"{kept.entry}{self.labels[s.lead]}{self.labels[k]}"
                along = rotor * (U[k] * inverse if k == s.lead else G[k]) if geared else 0
                Q[s.lead][k] = Q[k][s.lead] = let(name, s.completed(Q[k], along), "Eq. 44")
            along = tau - rotor * driven if geared else tau
            p[s.lead] = let(f"{kept.force}{self.labels[s.lead]}", s.completed(p, along), "Eq. 45")

    def _pivot(self, D: Value) -> Value:
        if not is_zero(D):
            return D
        if not self.x.structural:
            raise ZeroPivotError(self.kind)
        return ANY  # the zero patterns of the children are not known yet

    def block(self, row: int, column: int) -> Matrix:
        """The 6x6 block of Q that begins at this row and column."""
        return [self.Q[row + i][column : column + 6] for i in SIX]


def eliminate_force(
    x: Scope, kept: PivotFields, right: Store, j: int, s: Column, P: Vector, tau: Value, labels: Sequence[str],
    left: range | None = None, rotor: Value = 0,
) -> None:  # fmt: skip
    """Repeat the elimination of a degree of freedom for another force P: compute ``r = tau - s . P`` and add ``G r`` to P.

    The statements run over directions. `right` is the store that receives ``r / D``.
    """
    r = x.let("r", tau - s.along(P), "d Eq. 53", lanes=True)
    driven = x.let("rD", r * x.load(kept.store, kept.inverse(j)), "d Eq. 53", lanes=True)
    x.store(right, kept.right_side(j), driven)
    left = range(len(P)) if left is None else left
    G = {i: x.load(kept.store, kept.gain(j, i)) for i in left}
    for i in left:
        if i != s.lead:
            P[i] = x.let(f"{kept.moving}{labels[i]}", P[i] + G[i] * r, "d Eq. 45", lanes=True)
    if s.lead in left:
        along = tau if is_zero(rotor) else tau - rotor * driven
        P[s.lead] = x.let(f"{kept.moving}{labels[s.lead]}", s.completed(P, along), "d Eq. 45", lanes=True)


def substitute(
    x: Scope,
    kept: PivotFields,
    right: Store | Value,
    j: int,
    s: Column,
    a: Vector,
    name: str,
    lanes: bool,
    geared: bool = False,
    of: str = "",
) -> Value:
    """The acceleration of a degree of freedom, ``r / D - G . a``; adds s times this acceleration to a, in place.

    Degrees of freedom are substituted in the reverse order of their elimination. `right` is ``r / D`` or the store that
    contains it, `geared` whether a rotor turns with the joint, and `of` the prefix of equation numbers in comments.
    """
    # without a rotor s . G = 1, so G . a depends on the leading component of a only through a - s a_lead
    G = [1 if i == s.lead and not geared else x.load(kept.store, kept.gain(j, i)) for i in range(len(a))]
    value = x.load(right, kept.right_side(j)) if isinstance(right, Store) else right
    for i, gain in enumerate(G):
        value = value - gain * s.remaining(x, i, a, lanes)
    found = x.let(name, value, f"{of}Eq. 53", lanes=lanes)
    for i, moved in s.added(a, found).items():
        a[i] = x.let("A", moved, f"{of}Eq. 54", lanes=lanes)
    return found
