"""The reference engine on symbols: mass matrix, right side and constraints as polynomials."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import sympy

from ..model.forces import ForceElement
from ..model.model import Coupling, Model
from ..model.outputs import Output
from ..model.places import Face, Point
from ..reference.arguments import State
from ..reference.arithmetic import Arithmetic, Array
from ..reference.closure import EarClosure, cut
from ..reference.ears import Group
from ..reference.forces import End, Wrench
from ..reference.outputs import VALUES, Moving, Seen
from ..reference.pairs import Pair, Pairs
from ..reference.recursive import RecursiveEngine
from ..reference.terms import Terms
from .arithmetic import SymbolicArithmetic
from .errors import SymbolicError, TooLargeError
from .names import unused_prefix
from .polynomials import Polynomial, UndecidedError

MOST_TERMS = 20_000
"""Largest expected number of terms of equations that are computed without `force`."""


def symbols_of(names: Sequence[str], prefix: str = "") -> tuple[sympy.Symbol, ...]:
    """Real symbols with given names, such as ``q.crank``."""
    return tuple(sympy.Symbol(f"{prefix}{name}", real=True) for name in names)


@dataclass
class Constraints:
    """The independent conditions of closed loops, over all speeds of the tree.

    Attributes
    ----------
    names : list of str
        Names of the conditions, ear by ear.
    position : (r, 1) array
        Residuals, which are zero if the loops are closed: m, and sines of angles.
    jacobian : (r, nu) array
    remainder : (r, 1) array
        Terms of the second time derivative of `position` other than the Jacobian times the accelerations that are not prescribed.
    """

    names: list[str]
    position: Array
    jacobian: Array
    remainder: Array


class SymbolicEngine(RecursiveEngine):
    """The recursive engine at a state of symbols; linear conditions of loops are in metres.

    Parameters
    ----------
    model : Model
    parameters : mapping of str to number or sympy.Expr
        Values of parameters that shall not be symbols.
    most_products : int, optional
        Products of terms; more raise `TooManyProductsError`.
    intermediates : bool, optional
        Long sums become intermediate variables.
    """

    def __init__(
        self,
        model: Model,
        parameters: Mapping[str, Any],
        most_products: int | None = None,
        intermediates: bool = False,
    ) -> None:
        self.intermediates = intermediates
        values = [s.name for x in parameters.values() for s in getattr(x, "free_symbols", ())]
        known = (*model.parameter_names, *model.inputs, *values)
        self.symbolic = SymbolicArithmetic(most_products, unused_prefix("z", known) if intermediates else "")
        super().__init__(model, self.symbolic)
        self.lengths = (1,) * len(self.model.loops)
        self.q = symbols_of(self.given.coordinate_names, "q.")
        self.u = symbols_of(self.given.speed_names, "u.")
        self.udot = symbols_of(self.given.speed_names, "udot.")
        self.p = tuple(parameters.get(p.name, sympy.Symbol(p.name, real=True)) for p in self.model.parameters)
        self.inputs = symbols_of(self.model.inputs)
        self.t = sympy.Symbol("t", real=True)

    @cached_property
    def state(self) -> State:
        """All arguments as symbols; speeds need not close the loops."""
        return self._arguments(self.q, self.u, self.p, self.inputs, self.t)

    @cached_property
    def bodies(self) -> list[Terms]:
        """The bodies at `state`, from the kinematic sweep."""
        return super()._motion(self.state)

    def _motion(self, state: State) -> list[Terms]:
        return self.bodies if state is self.state else super()._motion(state)

    def _accelerations(self, state: State) -> Pair:
        """All accelerations: symbols, and the values of prescribed ones."""
        return self._with_accelerations(self._of_speeds("udot", self.udot, None, state.pairs), state.pairs)

    def _closed_speeds(self, state: State) -> Pair:
        """The dependent speeds that follow from the independent speeds of the state."""
        others = [i for i in range(self.model.nu) if i not in set(self.dependent.tolist())]
        value = self.motion_of_tree[self.dependent][:, others] @ state.u.value[others]
        return Pair(value, self.arithmetic.zeros(0, *value.shape))

    def _point(self, motion: list[Terms], body: int, at: Pair) -> tuple[Pair, Pair]:
        x, v = super()._point(motion, body, at)
        return self.symbolic.closed(x), self.symbolic.closed(v)

    def _attitude(self, motion: list[Terms], body: int) -> tuple[Pair, Pair]:
        R, omega = super()._attitude(motion, body)
        return self.symbolic.closed(R), self.symbolic.closed(omega)

    def _wrenches_of(
        self, element: ForceElement, pairs: Pairs, motion: list[Terms]
    ) -> Iterator[tuple[Point | Face, End, Wrench]]:
        try:
            for point, end, wrench in super()._wrenches_of(element, pairs, motion):
                force, torque = (None if x is None else self.symbolic.closed(x) for x in (wrench.force, wrench.torque))
                yield point, end, Wrench(force, torque)
        except UndecidedError as error:
            raise SymbolicError(
                f"{element.type} {element.name}: its law has different formulas in different states ({error})"
            ) from None
        except ValueError as error:  # the element has no direction; the message names it
            raise SymbolicError(str(error)) from None

    def _energies(self, state: State, motion: list[Terms]) -> tuple[Pair, Pair]:
        """The energies of a state; the kinetic energy follows from the mass matrix."""
        pairs, u = state.pairs, state.u.value
        potential = pairs.matrix([[self._potential(pairs, motion)]])
        for b in motion[: len(self.model.bodies)]:
            potential = potential - self._gravity(pairs).mT @ b.x * b.I[5, 5]
        return Pair(u.T @ self.mass @ u / 2, potential.tangent), potential

    def _moving(self, state: State, motion: list[Terms]) -> list[Moving]:
        closed = [replace(b, N_C=self.symbolic.closed(b.N_C), V=self.symbolic.closed(b.V)) for b in motion]
        return super()._moving(state, closed)

    # --- trees ----------------------------------------------------------------------------------------------------

    @cached_property
    def mass(self) -> Array:
        """The mass matrix M over all speeds of the tree, including prescribed ones, (nu, nu)."""
        return self._mass_matrix(self.state).value

    @cached_property
    def right_side(self) -> Array:
        """K minus the forces of prescribed accelerations, (nu, 1), for all speeds of the tree."""
        pairs = self.state.pairs
        return -self._inverse_dynamics(self.state, pairs.zeros(self.model.nu, 1)).value

    @cached_property
    def rates(self) -> Array:
        """The time derivatives of the coordinates that are not prescribed, (nq, 1)."""
        return self._coordinate_rates(self.state).value[self.free_q]

    @cached_property
    def seen(self) -> Seen:
        """Motions of bodies and sums over them, which outputs read."""
        return self._seen(self.state)

    def output(self, output: Output) -> Polynomial:
        """The value of an output as a polynomial."""
        value: Polynomial = VALUES[output.measure](output, self.seen).value
        return value

    # --- loops ----------------------------------------------------------------------------------------------------

    @cached_property
    def constraints(self) -> Constraints:
        """As many independent conditions as there are dependent speeds, chosen at the assembled initial configuration."""
        every = self._every_condition
        at = self._initial_values()
        rows: list[int] = []
        for ear in self.partition.ears:
            slices = [self.closure_slices[k] for k in ear.loops]
            own = [i for s in slices for i in range(s.start, s.stop) if i in set(self.kept.tolist())]
            numbers = self.symbolic.algebra.evaluated(every.jacobian[np.ix_(own, ear.dependent)], at)
            best, _ = Arithmetic().independent_rows(numbers)
            rows += [own[i] for i in sorted(best[: len(ear.dependent)].tolist())]
        return Constraints(
            [every.names[i] for i in rows], every.position[rows], every.jacobian[rows], every.remainder[rows]
        )

    def _initial_values(self) -> dict[sympy.Symbol, float]:
        q = dict(zip(self.q, np.array(self.partition.q)[self.free_q].tolist(), strict=True))
        p = {s: p.value for s, p in zip(self.p, self.model.parameters, strict=True) if isinstance(s, sympy.Symbol)}
        return q | p | dict.fromkeys((*self.u, *self.inputs, self.t), 0.0)

    @cached_property
    def _every_condition(self) -> Constraints:
        """All closing conditions, including redundant ones."""
        pairs, model, bodies = self.state.pairs, self.model, self.bodies
        speeds = tuple(range(model.nu))
        tree = Group(tuple(model.outward), (), (), (), speeds)
        G = EarClosure(model, tree, pairs, bodies, ()).partial_velocities(speeds)
        none = pairs.zeros(6, model.nu)
        position, jacobian, remainder = [], [], []
        given = self._given_accelerations(pairs)
        for loop in model.loops:
            if isinstance(loop, Coupling):
                row = self._coupled(loop)
                value = -pairs.matrix([[pairs.expression(loop.offset)]])
                for term in loop.terms:
                    at = model.coordinate_slices[term.body][0].start + term.index
                    value = value + self.state.q[at : at + 1] * pairs.expression(term.factor)
                position.append([value])
                jacobian.append([row])
                remainder.append([row @ given])
                continue
            start, end = loop.start.body, loop.end.body
            joint = cut(pairs, loop, 1, bodies[start], bodies[end], model.defaults, ())
            linear = joint.rows[: loop.closure.linear, 3:] @ joint.offset
            values = [value for value, _, _ in joint.surfaces] or [linear, *joint.sines(pairs)]
            position += [[value] for value in values]
            jacobian.append([joint.K_end @ G.get(end, none) - joint.K_start @ G.get(start, none)])
            remainder.append([joint.remainder(pairs, bodies[start], bodies[end])])
        return Constraints(
            list(model.closure_names), *(pairs.block(of).value for of in (position, jacobian, remainder))
        )

    def _coupled(self, loop: Coupling) -> Pair:
        row = self.state.pairs.zeros(1, self.model.nu)
        for term in loop.terms:
            at = self.model.coordinate_slices[term.body][1].start + term.index
            row.value[0, at] = self.state.pairs.expression(term.factor).value
        return row

    @cached_property
    def _solved(self) -> tuple[Array, Array]:
        """The map from independent speeds to all speeds, (nu, nu), and the accelerations when the independent
        accelerations are zero, (nu, 1)."""
        known, nu = self.constraints, self.model.nu
        motion, besides = self.arithmetic.eye(nu), self.arithmetic.zeros(nu, 1)
        for i in self.dependent:
            motion[i, i] = self.arithmetic.number(0)
        first = 0
        for ear in self.partition.ears:
            D, rows = list(ear.dependent), list(range(first, first + len(ear.dependent)))
            first += len(D)
            A, J = known.jacobian[np.ix_(rows, D)], known.jacobian[rows].copy()
            J[:, D] = 0 * J[:, D]
            right = np.concatenate([J @ motion, known.remainder[rows] + J @ besides], axis=1)
            large = self.intermediates and len(D) > LARGEST_INVERSE
            found = -(orthogonal_solution(A, right) if large else self._inverse_of(A) @ right)
            motion[D], besides[D] = found[:, :-1], found[:, -1:]
        return motion, besides

    @property
    def motion_of_tree(self) -> Array:
        """The map from independent speeds to all speeds of the tree, (nu, nu); columns of dependent speeds are zero."""
        return self._solved[0]

    @property
    def remainder_of_tree(self) -> Array:
        """Accelerations of the dependent speeds when the accelerations of the independent speeds are zero, (nu, 1)."""
        return self._solved[1]

    def _inverse_of(self, A: Array) -> Array:
        """The inverse of a matrix by its cofactors, (n, n).

        Raises
        ------
        TooLargeError
            If the inverse would have too many terms, and products are limited.
        """
        n = len(A)
        if not n:
            return A
        every = tuple(range(n))
        expected = n * _Minors(np.array([[len(x.terms) for x in line] for line in A], dtype=float), 1).of(every, every)
        if self.symbolic.algebra.most_products is not None and expected > MOST_TERMS:
            raise TooLargeError(f"about {expected:.0e} terms in the embedded form")
        minors = _Minors(A)
        determinant = minors.of(every, every)
        share = self.symbolic.algebra.reciprocal(determinant)
        inverse = self.arithmetic.zeros(n, n)
        for i in range(n):
            for j in range(n):
                rows, columns = (tuple(k for k in range(n) if k != x) for x in (j, i))
                inverse[i, j] = minors.of(rows, columns) * (-1) ** (i + j) * share
        return inverse


LARGEST_INVERSE = 3
"""With intermediate variables, largest number of rows for inversion by cofactors; `orthogonal_solution` takes larger matrices."""


def orthogonal_solution(A: Array, B: Array) -> Array:
    """X of A X = B, (n, c), for a regular A (n, n).

    The columns of A are made orthogonal one after another, as in the paper's elimination of loops, and B is transformed
    with them. Where A is regular, no pivot is zero, so no pivot has to be chosen.
    """
    A, B, n = A.copy(), B.copy(), len(A)
    R, X = np.zeros((n, n), dtype=object), np.zeros(B.shape, dtype=object)
    for j in range(n):
        a = A[:, j]
        share = 1 / (a @ a)
        for k in range(j + 1, n):
            R[j, k] = a @ A[:, k] * share
            A[:, k] = A[:, k] - a * R[j, k]
        X[j] = a @ B * share
        B = B - np.outer(a, X[j])
    for j in reversed(range(n)):
        X[j] = X[j] - R[j, j + 1 :] @ X[j + 1 :]
    return X


class _Minors:
    """Minors of a matrix, each computed once. With the sign 1 they are permanents, in which all products are added."""

    def __init__(self, A: Array, sign: int = -1) -> None:
        self.A, self.sign = A, sign
        self.known: dict[tuple[tuple[int, ...], tuple[int, ...]], Any] = {((), ()): 1}

    def of(self, rows: tuple[int, ...], columns: tuple[int, ...]) -> Any:
        """The minor of these rows and columns, by expansion along its first row."""
        if (rows, columns) not in self.known:
            total: Any = 0
            for k, column in enumerate(columns):
                entry = self.A[rows[0], column]
                if entry:
                    rest = columns[:k] + columns[k + 1 :]
                    total = entry * self.sign**k * self.of(rows[1:], rest) + total
            self.known[rows, columns] = total
        return self.known[rows, columns]


def matrix_of(of: Array) -> sympy.Matrix:
    """A matrix of sympy's expressions from an array of polynomials."""
    return sympy.Matrix(*of.shape, [x.expression if isinstance(x, Polynomial) else x for x in of.flat])
