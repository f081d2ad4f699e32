"""Joints of links: the identities of each, with its statements as formulas of sympy, differentiated, at random values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import sympy
from joint_types import OTHERS

from codegen.mechanics.joints import LINK_JOINTS, Column, LinkJoint
from codegen.mechanics.joints.inertia import shift_inertia
from codegen.mechanics.spatial import skew
from codegen.mechanics.stores import CONSTANTS, COORDINATES, DP, DQ, SPEEDS, TRIG, TURNS
from codegen.mechanics.structure.links import parts_of
from codegen.model.joints import JOINTS
from codegen.model.motions import Displacement, Slide, Turn
from codegen.program.algebra import Number
from codegen.program.block import Scope
from codegen.program.field import XYZ

every_joint = pytest.mark.parametrize("joint", LINK_JOINTS, ids=lambda joint: joint.__name__)
Array = np.ndarray


class Formulas(Scope):
    """Statements as formulas without names: loaded values are symbols, sines of coordinates, or values stored before."""

    structural = tangents = units = False
    title = "test"

    def __init__(self, given: Mapping[tuple[str, str], Any]):
        self.reads: dict[Any, Any] = {}
        self.writes: dict[Any, Any] = {}
        self.given = dict(given)

    def component(self, store, name):
        key = store.name, name
        return self.given[key] if key in self.given else sympy.Symbol(f"{store.name}_{name}")

    def set_component(self, store, name, value):
        self.given[store.name, name] = sympy.sympify(value)

    def let(self, name, value, tag="", lanes=False):
        return value

    def name(self, name, value, tag=""):
        return value

    def number(self, value):
        return sympy.sympify(value.value if isinstance(value, Number) else value)

    def sqrt(self, value):
        return sympy.sqrt(value)

    def call(self, function, *arguments):
        raise NotImplementedError

    def recall(self, store, field, value):
        raise NotImplementedError


class Case:
    """A joint at random numbers: `formula` has its statements, `value` their values."""

    def __init__(self, joint: type[LinkJoint], aligned: bool = False, axis: int = 1):
        rng = np.random.default_rng(len(joint.__name__) + axis)
        n, m = joint.coordinates, joint.freedoms
        self.q, self.u = (sympy.symbols(f"{s.name}_:{k}") for s, k in ((COORDINATES, n), (SPEEDS, m)))
        self.dq = sympy.symbols(f"{DQ.name}_:{n}")
        given: dict[tuple[str, str], Any] = {}
        for store, row in ((COORDINATES, self.q), (SPEEDS, self.u), (DQ, self.dq)):
            given |= {(store.name, str(i)): e for i, e in enumerate(row)}
        if joint.angle is not None:
            given[TRIG.name, "cos"], given[TRIG.name, "sin"] = (f(self.q[joint.angle]) for f in (sympy.cos, sympy.sin))
        fixed = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        self.fixed = np.eye(3) if aligned else fixed * np.linalg.det(fixed)
        self.numbers = {
            e: float(x)
            for row in (self.q, self.u, self.dq)
            for e, x in zip(row, rng.normal(size=len(row)), strict=True)
        }
        for i, row in enumerate(self.fixed):
            for j, x in enumerate(row):
                given[CONSTANTS.name, f"R.{XYZ[i]}{XYZ[j]}"] = sympy.Float(x, 17)
        self.x = Formulas(given)
        self.joint = joint(self.x, SimpleNamespace(axis=axis, aligned=aligned, parameters=1))
        if joint.quaternion is not None:
            self.joint.write_rotation()
            self.joint.write_turn()
        self.rng = rng

    def value(self, formula: Any) -> Array:
        """The values of expressions; symbols without a value get random ones."""
        a = np.array(formula, dtype=object)
        flat = [sympy.sympify(e) for e in a.flat]
        used = sorted(set[sympy.Symbol]().union(*(e.free_symbols for e in flat)), key=str)
        for symbol in used:
            if symbol not in self.numbers:
                self.numbers[symbol] = float(self.rng.normal())
        found = sympy.lambdify(used, flat, "math")(*(self.numbers[s] for s in used))
        return np.array(found, dtype=float).reshape(a.shape)

    def turned(self) -> list[list[Any]]:
        """Components along the parent's axes from those along the link's."""
        return self.joint.attitude([[sympy.Integer(i == j) for j in range(3)] for i in range(3)])

    def along(self, formula: Any, of: Sequence[Any], rates: Sequence[Any]) -> Any:
        """Derivative of formulas for given rates of symbols."""
        one = lambda e: sum((sympy.diff(e, s) * r for s, r in zip(of, rates, strict=True)), sympy.Integer(0))  # noqa: E731
        return [[one(e) for e in row] if isinstance(row, list) else one(row) for row in formula]

    def twist(self, rates: Sequence[Any]) -> Array:
        """Rotation vector and displacement of the link for rates of its coordinates, along its axes, from its pose."""
        R = self.value(self.turned())
        W = R.T @ self.value(self.along(self.turned(), self.q, rates))
        v = R.T @ self.value(self.along(self.joint.offset(), self.q, rates))
        return np.array([W[2, 1], W[0, 2], W[1, 0], *v])

    def columns(self) -> Array:
        """Motions of the link per unit speed, (6, freedoms)."""
        return self.value([[s[i] for s in self.joint.columns] for i in range(6)])


def close(a: Any, b: Any) -> None:
    np.testing.assert_allclose(a, b, rtol=0, atol=1e-13 * max(1.0, np.abs(b).max(initial=0)))


@every_joint
@pytest.mark.parametrize("aligned", [True, False])
def test_vectors_pass_by_a_rotation_and_back(joint, aligned):
    for axis in range(3):
        case = Case(joint, aligned, axis)
        R, v = case.value(case.turned()), sympy.symbols("v:3")
        close(R.T @ R, np.eye(3))
        assert np.linalg.det(R) > 0
        there, back = case.joint.to_parent(list(v), "v", ""), case.joint.to_child(list(v), "v", "")
        close(case.value(there), R @ case.value(v))
        close(case.value(back), R.T @ case.value(v))


@every_joint
@pytest.mark.parametrize("aligned", [True, False])
def test_inertias_are_turned_as_matrices(joint, aligned):
    case = Case(joint, aligned)
    R = case.value(case.turned())
    J, H, M = (np.array(sympy.symbols(f"{name}:9")).reshape(3, 3).tolist() for name in "JHM")
    for m in (J, M):
        for i in range(3):
            for j in range(i):
                m[i][j] = m[j][i]
    found = case.joint.inertia_to_parent(*([list(row) for row in m] for m in (J, H, M)), "")
    for turned, m in zip(found, (J, H, M), strict=True):
        close(case.value(turned), R @ case.value(m) @ R.T)
    r = sympy.symbols("r:3")
    S = np.block([[np.eye(3), case.value(skew(r))], [np.zeros((3, 3)), np.eye(3)]])
    J_r, H_r, M_r = (case.value(m) for m in shift_inertia(case.x, list(r), J, H, M, ""))
    J, H, M = (case.value(m) for m in (J, H, M))
    close(np.block([[J_r, H_r], [H_r.T, M_r]]), S @ np.block([[J, H], [H.T, M]]) @ S.T)


@every_joint
def test_columns_are_the_pose_differentiated_and_power_is_force_times_speed(joint):
    case = Case(joint)
    assert len(case.joint.columns) == joint.freedoms
    assert len(case.joint.rates()) == joint.coordinates
    twist = case.twist(case.joint.rates())
    close(case.columns() @ case.value(case.u), twist)
    close([*case.value(case.joint.turning([0] * 3)), *case.value(case.joint.sliding([0] * 3))], twist)
    wrench = sympy.symbols("n:3 f:3")
    of_joint = case.value([s.along(list(wrench)) for s in case.joint.columns])
    close(of_joint @ case.value(case.u), case.value(wrench) @ twist)
    w = case.value(sympy.symbols("w:3"))
    close(case.value(case.joint.turning(list(w)))[:3], w + twist[:3])
    close(case.value(case.joint.sliding(list(w)))[:3], w + twist[3:])


@every_joint
def test_the_bias_is_the_acceleration_that_is_left(joint):
    case = Case(joint)
    rates = case.joint.rates()
    velocity = case.along(case.joint.offset(), case.q, rates)
    R, w = case.value(case.turned()), case.value(sympy.symbols("w:3"))
    own = R.T @ case.value(case.along(velocity, case.q, rates))  # speeds being constant
    twist = case.twist(rates)
    angular, linear = case.joint.bias([sympy.Float(e, 17) for e in w])
    close(case.value(angular), np.cross(w, twist[:3]))
    close(case.value(linear), own + 2 * np.cross(w, twist[3:]))
    assert joint.swings or np.abs(own).max() < 1e-13
    assert not joint.swings or np.abs(own).max() > 1e-3


@every_joint
def test_displacements_are_the_pose_differentiated(joint):
    case = Case(joint)
    twist = case.twist(case.dq)
    turn, slide = case.joint.displacement()
    close(case.value([*turn, *slide]), twist)
    freedoms = range(joint.freedoms)
    close(case.columns() @ case.value([case.joint.along_freedom(j) for j in freedoms]), twist)
    # coordinates moved as they follow from displacements along all freedoms give these displacements
    for lanes in (False, True):
        wanted = sympy.symbols(f"s:{joint.freedoms}")
        found = case.joint.coordinate_changes(dict(zip(freedoms, wanted, strict=True)), lanes)
        assert sorted(found) == list(range(joint.coordinates)) == sorted(joint.moved_by(freedoms))
        if joint.quaternion is not None:  # of a unit quaternion
            e = [case.q[joint.quaternion + m] for m in range(4)]
            length = np.linalg.norm(case.value(e))
            case.numbers |= {s: case.numbers[s] / length for s in e}
        close(case.twist([found[i] for i in range(joint.coordinates)]), case.columns() @ case.value(wanted))


@every_joint
def test_what_is_transparent_has_the_derivatives_of_sympy(joint):
    case = Case(joint)
    for formula, inner in case.joint.transparent().items():
        expected = sum(sympy.diff(formula, s) * d for s, d in zip(case.q, case.dq, strict=True))
        found = 0
        for root, value in inner.items():
            store, _, component = str(root).rpartition("_")
            assert store == TURNS.name
            found += value * joint.turn_seed(case.x, component)
        close(case.value([found]), case.value([expected]))
    assert bool(case.joint.transparent()) == (joint.angle is not None or joint.quaternion is not None)


@every_joint
def test_parameters_move_what_slides(joint):
    case = Case(joint)
    factor, change = case.x.component(CONSTANTS, "factor"), case.x.component(CONSTANTS, "factor/0")
    way, by = case.joint.way(), case.joint.way_by(0)
    has_factor = any(isinstance(m, Slide) and m.factor is not None for m in joint.motion)
    assert has_factor == any(e.has(factor) for e in map(sympy.sympify, way or []))
    expected = [sympy.diff(e, factor) * change for e in map(sympy.sympify, way or [0] * 3)]
    close(case.value(by or [0] * 3), case.value(expected))
    v = sympy.symbols("v:6")
    for s in case.joint.columns:
        expected = sympy.diff(sympy.sympify(s.along(list(v))), factor) * change * case.x.component(DP, "0")
        close(case.value([s.change(case.x, list(v))]), case.value([expected]))


# -- columns ---------------------------------------------------------------------------------------------------------------


def test_a_column_with_several_components():
    rng = np.random.default_rng(5)
    s, x = Column(1, {4: 0.3, 5: -0.7}), Formulas({})
    dense = np.array([s[i] for i in range(6)])
    np.testing.assert_array_equal(dense, [0, 1, 0, 0, 0.3, -0.7])
    np.testing.assert_array_equal([*s.angular, *s.linear], dense)
    v, G = rng.normal(size=(2, 6)).tolist()
    close(s.along(v), dense @ v)
    close(s.squares_along([2.0, 3.0]), dense @ np.diag([2, 2, 2, 3, 3, 3]) @ dense)
    completed = list(v)
    completed[1] = s.completed(v, 0.4)
    close(dense @ completed, 0.4)
    added = {**dict(enumerate(v)), **s.added(v, 0.9)}
    close([added[i] for i in range(6)], v + 0.9 * dense)
    # G . v where s . G = 1, by what the leading component leaves of the others
    G[1] = s.completed(G, 1)
    remaining = [s.remaining(x, i, v, False) for i in range(6)]
    close(v[1] + sum(G[i] * remaining[i] for i in range(6) if i != 1), np.dot(G, v))


# -- joints of bodies --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "kind", [*(kind for kind in JOINTS.values() if kind.carries), OTHERS["polar"]], ids=lambda kind: kind.name
)
def test_the_links_of_a_joint_move_as_it_does(kind):
    motion: list[Any] = []
    for part in parts_of(kind.motion, kind.triad):
        own = dict(zip(part.joint.motion, kind.motion[len(motion) :], strict=False))
        for here, there in own.items():
            assert type(here) is type(there)
            if isinstance(here, Turn | Slide):
                assert there.axis == (part.axis + here.axis) % 3
                assert there.index == here.index + part.q == here.index + part.u
            else:
                assert (there.coordinate, there.speed) == (here.coordinate + part.q, here.speed + part.u)
        motion += own.values()
    assert tuple(motion) == kind.motion


def test_a_chain_that_no_links_move_by_is_refused():
    for kind in ("gimballed", "corkscrew", "geared"):
        with pytest.raises(TypeError, match="no joint of a link"):
            parts_of(OTHERS[kind].motion)
    with pytest.raises(TypeError, match=r"no joint of a link .* Displacement"):
        parts_of((Displacement(0, 0),))
    with pytest.raises(TypeError, match="share a coordinate"):
        parts_of((Turn(0, 0), Slide(1, 0)))
