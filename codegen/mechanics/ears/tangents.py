"""Tangents of an ear's statements. Vectors fixed in a link rotate with it; all other values are differentiated one by one.

A direction rotates a link by a rotation vector theta (along region axes). A vector v fixed in the link changes by ``theta x v``,
plus the change of its components with design parameters. This takes three numbers, not nine for each rotation matrix.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ...program import algebra
from ...program.algebra import Expr, Symbol
from ...program.block import ANY, Expansion, Statement, symbols_of
from ...program.derivatives import Tangents, of_symbols
from ...program.field import XYZ
from ...program.scalar import Value, Vector
from ...program.store import CONSTANT, Store
from ..spatial import UNIT, add, cross, is_zero, matvec
from ..stores import CL_DP, CL_PARAMETER, COORDINATES, DMOTION, DP, DQ, DU, LINK, MOTION, PARAMETER, SPEEDS, TURNS
from ..tree.tangents import pattern, tangent
from .geometry import EarGeometry


def tangents_of(values: Vector, tangents: Vector) -> dict[Symbol, Value]:
    """Maps symbols to their tangents. `values` are symbols, negated symbols or numbers; on zero patterns, the map is empty."""
    found: dict[Symbol, Value] = {}
    for value, moved in zip(values, tangents, strict=True):
        if isinstance(value, Symbol):
            found[value] = moved
        elif isinstance(value, Expr) and isinstance(opposite := -value, Symbol):
            found[opposite] = -moved
        else:
            assert value is ANY or not algebra.expression(value).free_symbols, f"{value} has no name"
    return found


def ear_tangents(
    ear: EarGeometry,
    angles: dict[int, Vector],
    roots: dict[Symbol, Value],
    dq: dict[tuple[int, int], Value] | None = None,
) -> EarTangents:
    """Tangents of the statements of an ear's block.

    Parameters
    ----------
    ear : EarGeometry
    angles : dict of int to Vector
        Rotation vectors along directions, of links (keys 0, 1, ...) and of roots (negative keys).
    roots : dict of Symbol to value
        Tangents of the values that the block loads from its roots; see `tangents_of`.
    dq : dict of (int, int) to value
        Displacements that the block has found itself, by link and coordinate. None if the seeds are complete: then an
        earlier block has stored the tangents of levers.
    """
    if isinstance(ear.x, Expansion):
        return WrittenTangents(ear, ear.x, angles, roots, dq)
    return EarTangents(angles)


class EarTangents:
    """The tangents of an ear in a run on zero patterns: they are patterns, too, and no statement is written."""

    def __init__(self, angles: dict[int, Vector]):
        self.angles = angles

    def run(self) -> None:
        """Differentiate the scalar statements written since the last call."""

    def of(self, value: Value, name: str = "d") -> Value:
        """The tangent of a value of the block."""
        return pattern(value)

    def vector(self, v: Sequence[Value], name: str = "d") -> Vector:
        """Tangents of the components of a vector."""
        return [self.of(e, f"{name}_{i}") for e, i in zip(v, XYZ, strict=True)]

    def correct(self, found: list[tuple[Vector, Vector]]) -> None:
        """Add terms to the tangents of named values, and recompute the tangents of values that depend on them.

        `found` lists vectors of values, each with the terms to add. A value that occurs more than once is corrected once.
        """

    def give(self, v: Vector, tangents: Vector) -> None:
        """Sets the tangents of named values to given ones."""

    def turn_joints(self) -> None:
        """Differentiates rotations from link to link as functions of the joints' sines, cosines and matrices."""

    def hold(self, v: Vector) -> None:
        """Excludes values from differentiation; other code sets their tangents, which are zero until then."""


class WrittenTangents(EarTangents):
    """Writes the tangents as statements; see `ear_tangents`."""

    def __init__(
        self,
        ear: EarGeometry,
        x: Expansion,
        angles: dict[int, Vector],
        roots: dict[Symbol, Value],
        dq: dict[tuple[int, int], Value] | None,
    ):
        super().__init__(angles)
        self.ear = ear
        self.stored = dq is None
        self.dq = dq or {}
        self.x = x
        self.done = 0
        self.scanned = 0
        self.fixed = 0
        self.known: set[Symbol] = set()
        self.turned: set[Symbol] = set()
        self.primitives: dict[Symbol, Statement] = {}
        self.values: set[Symbol] = set()
        self.d = Tangents(x, {}, {})
        self.d.of.update({s: algebra.expression(v) for s, v in roots.items() if not is_zero(v)})
        for place in [*range(len(ear.members)), *(-1 - t for t in range(len(ear.kind.roots)))]:
            self._attitude(place)

    def _scan(self) -> None:
        """Find the tangents of coordinates, speeds and other values that the block has loaded since the last call."""
        loads = list(self.x.block.loads.items())
        for symbol, (store, name) in loads[self.scanned :]:
            place = store.place
            if place is None:
                continue
            if store is SPEEDS[place]:
                self._seed(symbol, self.x.component(DU[place], name))
            elif store is COORDINATES[place]:
                found = self.dq.get((place, int(name)))
                self._seed(symbol, self.x.component(DQ[place], name) if found is None else found)
            elif store is MOTION[place]:
                self._seed(symbol, self.x.component(DMOTION[place], name))
            elif store is TURNS[place]:
                member = self.ear.members[place]
                self._seed(symbol, member.kind.joint.turn_seed(member.view, name))
            elif store.memory is CONSTANT and "/" not in name:
                self._transparent(symbol, store, place, name)
        self.scanned = len(loads)

    def _seed(self, symbol: Symbol, value: Value) -> None:
        if not is_zero(value) and symbol not in self.known:
            self.d.of[symbol] = algebra.expression(value)

    def _transparent(self, symbol: Symbol, store: Store, place: int, name: str) -> None:
        of_link = store.owner is LINK
        kinds = self.ear.kind.links if of_link else self.ear.kind.closures
        parameters, seeds = (PARAMETER, DP) if of_link else (CL_PARAMETER, CL_DP)
        inner: dict[Symbol, Expr] = {}
        for j in range(kinds[place].parameters):
            value = self.x.component(store, f"{name}/{j}")
            if not is_zero(value):
                root = self.x.symbol(parameters[place], j)
                inner[root] = value
                self._seed(root, self.x.entry(seeds[place], j))
        if inner:
            self.d.transparent[symbol] = inner

    def _attitude(self, place: int) -> None:
        W = self.ear.attitude(place)
        theta = self.angles.get(place)
        if W is UNIT or theta is None:
            return
        for j in range(3):
            turned = cross(theta, [W[i][j] for i in range(3)])
            for i in range(3):
                if isinstance(w := W[i][j], Symbol) and not is_zero(turned[i]):
                    self.d.of[w] = self.x.let("dW", turned[i], "d Eq. 22", lanes=True)

    def fixed_vectors(self) -> None:
        """Tangents of vectors fixed to links, for the vectors that were added since the last call."""
        while self.fixed < len(self.ear.fixed):
            self._scan()
            v = self.ear.fixed[self.fixed]
            self.fixed += 1
            if v.kept is not None and self.stored:
                self._set(v.found, self.x.load(*v.kept))
                continue
            W = self.ear.attitude(v.place)
            theta = self.angles.get(v.place)
            turned: Vector = [0, 0, 0] if theta is None else cross(theta, v.found)
            changed = [self._of_local(e) for e in v.local]
            self._set(v.found, add(turned, changed if W is UNIT else matvec(W, changed)))
            # if W is the unit matrix, region and link components are the same symbols: let their tangents be corrected
            self.turned.difference_update(e for e in v.local if isinstance(e, Symbol))

    def _set(self, found: Vector, moved: Vector) -> None:
        for i, symbol in enumerate(found):
            if not isinstance(symbol, Symbol) or symbol in self.x.block.loads or symbol in self.known:
                continue
            self.known.add(symbol)
            self.turned.add(symbol)
            value = self.x.let("d_fixed", moved[i], "d Eq. 22", lanes=True)
            if not is_zero(value):
                self.d.of[symbol] = value

    def _of_local(self, value: Value) -> Value:
        """Tangent of a component along a link's own axes: of a constant, or of statements on constants and coordinates."""
        if isinstance(value, Symbol) and value not in self.d.of and value not in self.x.block.loads:
            for statement in self.x.block.statements:
                if statement.target == value:
                    for operand in sorted(statement.expression.free_symbols, key=str):
                        self._of_local(operand)
                    self.d.statement(statement)
                    self.known.add(value)
                    break
        return tangent(self.d, value)

    def run(self) -> None:
        self._scan()
        self.fixed_vectors()
        statements = self.x.block.statements
        while self.done < len(statements):
            statement = statements[self.done]
            self.done += 1
            if statement.lanes or statement.target in self.known:
                continue
            if statement.tag == "primitive":
                self.primitives[statement.target] = statement
            else:
                self._as_values(symbols_of(statement.expression))
                self.d.statement(statement)

    def _as_values(self, symbols: Iterable[Symbol]) -> None:
        """Differentiate primitives that other statements read as values, such as the cosine in the gradient of a
        condition."""
        for symbol in sorted(symbols, key=str):
            statement = self.primitives.pop(symbol, None)
            if statement is not None:
                self._as_values(symbols_of(statement.expression))
                self.d.statement(statement)
                self.values.add(symbol)

    def of(self, value: Value, name: str = "d") -> Value:
        self._scan()
        self._as_values(symbols_of(algebra.expression(value)))
        return self.d.value(value, name)

    def correct(self, found: list[tuple[Vector, Vector]]) -> None:
        listed: set[Symbol] = set()
        changed: set[Symbol] = set()
        for v, more in found:
            for symbol, value in tangents_of(v, more).items():
                if symbol not in listed:
                    listed.add(symbol)
                    if not is_zero(value):
                        before = self.d.of.get(symbol, 0)
                        self.d.of[symbol] = self.x.let("d", before + value, "d Eq. 31", lanes=True)
                        changed.add(symbol)
        # vectors rotated into the region's axes are not read any more, so their tangents stay as they are
        right = listed | self.turned
        for statement in self.x.block.statements[: self.done]:
            if statement.lanes or statement.target in right:
                continue
            if statement.tag == "primitive" and statement.target not in self.values:
                continue
            if not changed.isdisjoint(symbols_of(statement.expression)):
                self.d.statement(statement)
                changed.add(statement.target)

    def give(self, v: Vector, tangents: Vector) -> None:
        self.d.of.update({s: algebra.expression(t) for s, t in tangents_of(v, tangents).items() if not is_zero(t)})
        self.hold(v)

    def turn_joints(self) -> None:
        for member in self.ear.members:
            self.d.transparent.update(of_symbols(member.joint.transparent()))

    def hold(self, v: Vector) -> None:
        self.known.update(tangents_of(v, v))
