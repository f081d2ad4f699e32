"""Roots of ears: one object for each sort, which gives its pose and motion, and takes forces."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from coupled_mechanisms import by_hand
from numeric_scope import Numbers
from scipy.spatial.transform import Rotation

from codegen.loops.partition import partition
from codegen.mechanics import fields
from codegen.mechanics.ears.motions import Motion, Twist
from codegen.mechanics.ears.roots import BY_ROLE, Root, roots_of
from codegen.mechanics.stores import (
    BASE,
    GROUND,
    LANE_BASE,
    LANE_ROOTS,
    LBASE,
    LGROUND,
    LREGION,
    LROOTS,
    REGION,
    ROOTS,
)
from codegen.mechanics.structure.kinds import EarKind
from codegen.mechanics.structure.system import analyse
from codegen.program.algebra import ONE

RNG = np.random.default_rng(5)
SOURCES, FAR = 2, 1
"""Independent speeds of the region; the place of the far link among the region's."""


def skew(v: Any) -> np.ndarray:
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def kind(role: str, *, rigid: bool = True, carried: bool = True, first: bool = True) -> EarKind:
    """The kind of an ear without links that has one root."""
    total = SOURCES + (6 * (FAR + 1) if role == "far" else 0 if rigid else 6)
    return EarKind(
        0, [], [], [role], [FAR if role == "far" else -1], [first], [], [], [], [], SOURCES, total, carried, rigid,
        ONE, ONE, True,
    )  # fmt: skip


def root(x: Numbers, role: str, **more: Any) -> Root:
    return roots_of(x, kind(role, **more))[0]


def drawn(x: Numbers, *stores_and_fields: Any) -> None:
    """Random numbers for the components of fields."""
    for store, field in stores_and_fields:
        for name in field.components:
            x.memory[store.label, name] = RNG.normal()


@pytest.fixture
def x() -> Numbers:
    """Where all that roots may load are random numbers, and attitudes are attitudes."""
    x = Numbers()
    stores = (BASE, GROUND, LANE_BASE, LBASE, LREGION, REGION, *(s[0] for s in (ROOTS, LROOTS, LANE_ROOTS)), LGROUND)
    far = (fields.far_position(FAR), fields.far_velocity(FAR), fields.far_shift(FAR), fields.far_step(FAR))
    motions = (fields.total, fields.remainder, fields.ear_total, fields.ear_remainder, fields.ear_own)
    motions += (fields.far_total(FAR), fields.far_remainder(FAR), fields.far_own(FAR))
    drawn(
        x,
        *((s, f) for s in stores for m in motions for f in (m.w, m.al, m.a, m.B)),
        *((s, f) for s in (REGION, LREGION) for f in far),
        *((s, f) for s in (BASE, LBASE, LANE_BASE) for f in (fields.closing_position, fields.closing_twist)),
        *((s, f) for s in (BASE, LBASE, LANE_BASE) for f in (fields.closing_shift, fields.step)),
        *((s[0], f) for s in (ROOTS, LROOTS, LANE_ROOTS) for f in (fields.measured_velocity, fields.shift)),
        *((ROOTS[0], f) for f in (fields.ear_position, fields.ear_step)),
        *((ROOTS[0], fields.per_source(c)) for c in range(SOURCES)),
    )
    for store, field in (
        (BASE, fields.closing_attitude),
        (ROOTS[0], fields.ear_attitude),
        (REGION, fields.far_attitude(FAR)),
    ):
        x.store(store, field, Rotation.random(random_state=7).as_matrix().tolist())
    return x


ALL = [("frame", {}), ("frame", {"rigid": False}), ("ground", {}), ("link", {}), ("far", {})]


def test_every_role_of_a_model_has_a_class():
    roles = set()
    for name in ("chain_on_four_bar", "chains_on_four_bar"):
        model = by_hand(name).model
        for unit_kind in analyse(model, False, partition(model)).unit_kinds:
            roles |= set(unit_kind.roots) if isinstance(unit_kind, EarKind) else set()
    assert roles == BY_ROLE.keys()


@pytest.mark.parametrize(("role", "more"), ALL)
def test_attitudes_turn(x, role, more):
    W = np.array(root(x, role, **more).attitude(), float)
    assert np.abs(W @ W.T - np.eye(3)).max() < 1e-15
    assert np.linalg.det(W) == pytest.approx(1)


def test_the_ground_is_seen_from_the_base(x):
    """A point fixed in the ground, at p from it, is W p + o in the base's axes: the base's own origin is at zero."""
    ground = root(x, "ground")
    W, o = np.array(ground.attitude()), np.array(ground.position())
    W_base, o_base = np.array(x.load(BASE, fields.closing_attitude)), np.array(x.load(BASE, fields.closing_position))
    assert np.abs(W @ W_base - np.eye(3)).max() < 1e-15
    assert np.abs(W @ o_base + o).max() < 1e-15


@pytest.mark.parametrize("store", [LBASE, LANE_BASE])
def test_the_ground_turns_back_as_the_base_turns(x, store):
    """With dW_base = W_base theta x and do_base = W_base d of the base the ground's pose W_base^T, -W_base^T o_base changes."""
    ground, kept = root(x, "ground"), store is LANE_BASE
    W_base, o_base = np.array(x.load(BASE, fields.closing_attitude)), np.array(x.load(BASE, fields.closing_position))
    six = x.load(store, fields.closing_shift)
    dW_base, do_base = W_base @ skew(six[:3]), W_base @ six[3:]
    dW, do = dW_base.T, -dW_base.T @ o_base - W_base.T @ do_base
    assert np.abs(skew(ground.rotation(kept)) @ ground.attitude() - dW).max() < 1e-14
    assert np.abs(np.array(ground.displacement(kept)) - do).max() < 1e-14


def test_newtons_step_of_the_ground_is_a_displacement(x):
    """Its step is to the base's step what its displacement is to the base's displacement."""
    for name, value in zip(fields.step.components, x.load(LANE_BASE, fields.closing_shift), strict=True):
        x.memory[BASE.label, name] = value
    ground = root(x, "ground")
    assert ground.step().six == pytest.approx([*ground.rotation(True), *ground.displacement(True)])


def test_the_ground_accelerates_as_gravity_has_it(x):
    ground = root(x, "ground")
    for total, motion in ((False, fields.remainder), (True, fields.total)):
        a = np.array(x.load(BASE, fields.closing_attitude)).T @ x.load(GROUND, motion.a)
        found = ground.motion(total)
        assert found.a == pytest.approx(a)
        assert not np.any(found.w) and not np.any(found.al) and not np.any(found.B)
    own, tangent = ground.own_motion()
    assert own.a == x.load(GROUND, fields.total.a) and tangent.a == x.load(LGROUND, fields.remainder.a)


@pytest.mark.parametrize(("role", "more"), ALL)
def test_a_root_moves_with_the_sources_as_fast_as_measured(x, role, more):
    """The speeds of the sources, each times how the root moves with it, are its velocity."""
    one = root(x, role, **more)
    speeds = RNG.normal(size=one.kind.total)
    if role == "far":
        speeds[SOURCES + 6 * FAR :] = x.load(REGION, fields.far_velocity(FAR))
    elif more:
        speeds[SOURCES:] = x.load(BASE, fields.closing_twist)
    elif role == "link":
        x.store(ROOTS[0], fields.measured_velocity, sum(s * np.array(one.twist(c).six) for c, s in enumerate(speeds)))
    found = sum((s * np.array(one.twist(c).six, float) for c, s in enumerate(speeds)), np.zeros(6))
    assert found == pytest.approx(one.measured_velocity().six)
    moves = role in ("link", "far") or bool(more)
    assert moves == any(not one.twist(c).vanishes for c in range(one.kind.total))
    assert moves == bool(np.any(one.velocity_tangent(True)))


@pytest.mark.parametrize(("role", "more"), ALL)
def test_what_the_region_hangs_on_is_displaced_against_itself_by_nothing(x, role, more):
    one = root(x, role, **more)
    for kept in (False, True):
        assert (role == "frame") == (not np.any([*one.rotation(kept), *one.displacement(kept)]))
    assert (role == "frame") == (not np.any(one.step().six)) == (not np.any(one.position()))


@pytest.mark.parametrize(("role", "store", "own", "tangent", "fields_of"), [
    ("frame", BASE, fields.total, fields.remainder, (fields.total, fields.remainder)),
    ("link", ROOTS[0], fields.ear_own, fields.remainder, (fields.ear_total, fields.ear_remainder)),
    ("far", REGION, fields.far_own(FAR), fields.far_own(FAR), (fields.far_total(FAR), fields.far_remainder(FAR))),
])  # fmt: skip
def test_accelerations_of_roots_are_of_their_links(x, role, store, own, tangent, fields_of):
    lanes = {"frame": LBASE, "link": LROOTS[0], "far": LREGION}[role]
    one = root(x, role)
    for total, motion in zip((True, False), fields_of, strict=True):
        assert one.motion(total) == Motion.load(x, store, motion)
    assert one.own_motion() == (Motion.load(x, store, own), Motion.load(x, lanes, tangent))


@pytest.mark.parametrize(("role", "more"), ALL)
def test_forces_arrive_once_and_the_power_is_that_of_the_sources(x, role, more):
    """Two ears hand a force to the same root: it gets the sum, and along each source what the sum does along its twist."""
    one, two = (root(x, role, first=first, **more) for first in (True, False))
    received = {
        "frame": (REGION, fields.region_transmitted), "link": (ROOTS[0], fields.ear_transmitted),
        "far": (REGION, fields.far_transmitted(FAR)),
    }.get(role)  # fmt: skip
    forces = RNG.normal(size=(2, 6))
    before = dict(x.memory)
    one.receive(list(forces[0]))
    two.receive(list(forces[1]))
    if received is None:
        assert not one.needs_force and x.memory == before
        return
    assert one.needs_force
    taken = np.array(x.load(*received))
    for c in range(one.kind.total):
        alone = sum(np.dot(force, one.twist(c).six) for force in forces)
        assert taken @ np.array(one.twist(c).six) == pytest.approx(alone)


@pytest.mark.parametrize(("role", "more"), ALL)
def test_forces_in_own_axes_arrive_with_their_tangents(x, role, more):
    one, two = (root(x, role, first=first, **more) for first in (True, False))
    received = {
        "frame": ((REGION, fields.region_transmitted), (LREGION, fields.region_balance)),
        "link": ((ROOTS[0], fields.root_transmitted), (LROOTS[0], fields.root_transmitted)),
        "far": ((REGION, fields.far_transmitted(FAR)), (LREGION, fields.far_balance(FAR))),
    }.get(role, ())  # fmt: skip
    forces, tangents = RNG.normal(size=(2, 2, 6))
    before = dict(x.memory)
    one.receive_own(list(forces[0]), list(tangents[0]))
    two.receive_own(list(forces[1]), list(tangents[1]))
    for (store, field), values in zip(received, (forces, tangents), strict=bool(received)):
        assert x.load(store, field) == pytest.approx(values.sum(axis=0))
    assert received or x.memory == before


def test_a_base_that_is_the_ground_feels_nothing(x):
    assert not root(x, "frame", carried=False).needs_force and root(x, "frame").needs_force


def test_twists_add_up():
    one, two, lever = Twist.of(RNG.normal(size=6)), Twist.of(RNG.normal(size=6)), RNG.normal(size=3)
    assert one.plus(two).at(lever) == pytest.approx(np.add(one.at(lever), two.at(lever)))
    assert one.times(3).at(lever) == pytest.approx(3 * np.array(one.at(lever)))
    assert one.at(lever) == pytest.approx(one.linear + np.cross(one.angular, lever))
    assert Twist.zero().vanishes and not one.vanishes
