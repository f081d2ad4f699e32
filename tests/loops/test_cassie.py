"""Cassie with the digits of its file: loops that are planar to 7e-8 rad, assembled over the range of its joints.

Which random states can be closed at all, the independent coordinates held, is found by a second way: the loops' kinematics
written out below, and a search from many random dependents.
"""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from loop_closure import assemble, closure, independent_coordinates

import codegen
from codegen.loops import AssemblyError, partition
from codegen.loops.geometry import evaluator, parameter_values
from codegen.model import parse_model
from codegen.runtime import AssemblyError as NotAssembled

FILE = Path(__file__).parent / "cassie_v2.yaml"

LIMITS = {
    "left_hip_roll": (-0.2618, 0.3491), "right_hip_roll": (-0.3491, 0.2618), "hip_yaw": (-0.3840, 0.3840),
    "hip_pitch": (-0.8727, 1.3963), "knee": (-2.07694, 0.13963), "shin": (-0.34907, 0.34907),
    "tarsus": (-0.13963, 1.95477), "foot_crank": (-2.4435, -0.6109), "foot": (-2.4435, -0.6109),
}  # fmt: skip
"""rad, of the SDF file; the heel springs, Achilles rods and plantar rods have none there, nor in MuJoCo Menagerie's model."""

RANGES = {
    "any": dict.fromkeys(("heel_spring", "achilles_rod", "plantar_rod"), (-1.0, 1.0)),
    "as in use": {"heel_spring": (-0.34907, 0.34907), "achilles_rod": (-1.44, 0.21), "plantar_rod": (0.6109, 2.4435)},
}
"""rad, from which these are drawn. In use a heel spring, not much softer than the shin's, bends as far as that one; the Achilles
rod turns as far as it does in states within all these limits, the plantar rod against the crank."""

CLOSED = {"pitch": 1e-9, "plantar": 1e-6}
"""m. A plantar loop out of its plane by 7e-8 rad stays open by 4e-8 m."""

SEARCHES = 100
"""Random dependents from which a loop's closure is sought; 600 find no other state that can be closed, of 400."""

OTHER = ("shin", "achilles_rod", "foot_crank")
"""Independent coordinates of a leg that close nearly all over the limits, which the generator does not know."""


def limits(name):
    return LIMITS.get(name) or LIMITS.get(name.partition("_")[2])


def drawn(names, ranges, count, seed):
    """Random states in which every joint is drawn separately: most are open, and many cannot be closed."""
    rng = np.random.default_rng(seed)
    bounds = [limits(n) or RANGES[ranges].get(n.partition("_")[2], (-1.0, 1.0)) for n in names]
    q = np.stack([rng.uniform(*b, count) for b in bounds], axis=1)
    if "pelvis.qw" in names:
        e = rng.normal(size=(count, 4))
        q[:, 3:7] = e / np.linalg.norm(e, axis=1, keepdims=True)
    return q


def rotation(axis, angle):
    """Rodrigues' formula, (..., 3, 3)."""
    x, y, z = np.array(axis, float) / np.linalg.norm(axis)
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.asarray(angle)[..., None, None]
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * (K @ K)


class PointLoop:
    """A loop of hinges, closed in a point: from the body that both ends hang on, outward on both sides."""

    def __init__(self, model, loop):
        value = evaluator(parameter_values(model, None))
        paths = []
        for end in (loop.start, loop.end):
            path, k = [], end.body
            while k >= 0:
                path.insert(0, k)
                k = model.bodies[k].parent
            paths.append(path)
        self.sides, self.names = [], []
        for end, path, other in ((loop.start, *paths), (loop.end, *paths[::-1])):
            hinges = []
            for k in (k for k in path if k not in other):
                body = model.bodies[k]
                R = np.eye(3)
                for axis, angle in body.joint.rotation:
                    R = R @ rotation(value(list(axis)), value([angle])[0])
                hinges.append((np.array(value(list(body.joint.at))), R, np.array(value(list(body.joint.axes[0])))))
                self.names.append(body.name)
            self.sides.append((hinges, np.array(value(list(end.at)))))
        self.closed = CLOSED["plantar" if "plantar" in loop.name else "pitch"]

    def gap(self, x):
        """From start to end, (S, 3), m, and its derivatives (S, 3, hinges)."""
        ends, columns, place = [], [], 0
        for sign, (hinges, point) in zip((-1, 1), self.sides, strict=True):
            R, o, axes, origins = np.broadcast_to(np.eye(3), (len(x), 3, 3)), np.zeros((len(x), 3)), [], []
            for at, turned, axis in hinges:
                o, R = o + R @ at, R @ turned
                axes.append(R @ (axis / np.linalg.norm(axis)))
                origins.append(o)
                R = R @ rotation(axis, x[:, place])
                place += 1
            ends.append(o + R @ point)
            columns += [sign * np.cross(w, ends[-1] - c) for w, c in zip(axes, origins, strict=True)]
        return ends[1] - ends[0], np.stack(columns, axis=2)

    def least(self, x, held):
        """The least residual (S,), m, with some hinges held, by Levenberg-Marquardt from many guesses."""
        free = [i for i, name in enumerate(self.names) if name not in held]
        rng = np.random.default_rng(7)
        y = np.repeat(x, SEARCHES, axis=0)
        y[:, free] = rng.uniform(-np.pi, np.pi, (len(y), len(free)))
        r, J = self.gap(y)
        damping = np.full(len(y), 1e-3)
        for _ in range(60):
            A = J[:, :, free]
            H = np.swapaxes(A, 1, 2) @ A
            H += (damping * np.trace(H, axis1=1, axis2=2))[:, None, None] * np.eye(len(free))
            step = -np.linalg.solve(H, np.swapaxes(A, 1, 2) @ r[..., None])[..., 0]
            trial = y.copy()
            trial[:, free] += step * np.minimum(1, 0.8 / np.maximum(np.abs(step).max(axis=1, keepdims=True), 1e-300))
            r_new, J_new = self.gap(trial)
            better = np.sum(r_new**2, axis=1) < np.sum(r**2, axis=1)
            y[better], r[better], J[better] = trial[better], r_new[better], J_new[better]
            damping = np.clip(np.where(better, damping / 5, damping * 4), 1e-14, 1e8)
        return np.linalg.norm(r, axis=1).reshape(len(x), SEARCHES).min(axis=1)


def can_close(model, held, q):
    """Which states can be closed with these coordinates held; the test is decisive for each of them."""
    places = {name: i for i, name in enumerate(model.coordinate_names)}
    possible = np.ones(len(q), dtype=bool)
    for loop in (PointLoop(model, x) for x in model.loops):
        left = loop.least(q[:, [places[n] for n in loop.names]], held)
        assert not np.any((left > loop.closed) & (left < 100 * loop.closed))
        possible &= left <= loop.closed
    return possible


@pytest.fixture(scope="module")
def cassie():
    return codegen.load_model(FILE)


@pytest.fixture(scope="module")
def chosen(cassie):
    return partition(cassie)


def with_other_hints(model):
    names = set(model.coordinate_names)
    return dataclasses.replace(
        model, independent=tuple(n for side in ("left", "right") for x in OTHER if (n := f"{side}_{x}") in names)
    )


def assembled(model, chosen, q, guess):
    """Which of some states are assembled, from all their coordinates or with dependents of the initial state."""
    kept = list(independent_coordinates(model, chosen))
    found = np.zeros(len(q), dtype=bool)
    for i, state in enumerate(q):
        start = np.array(state if guess == "whole" else chosen.q)
        start[kept] = state[kept]
        try:
            closed = assemble(model, chosen, start)
        except AssemblyError:
            continue
        assert np.array_equal(closed[kept], state[kept])
        found[i] = True
    return found


def test_the_nearly_planar_loop_is_told_though_the_initial_pose_is_flat(chosen):
    (told,) = [x for x in chosen.remarks if "right_plantar" in x]
    assert "taken as planar: axes agree to 7.4e-08 rad" in told
    assert len(chosen.independent) == 18


def test_what_is_dropped_does_not_hang_on_the_hints(cassie):
    """With the plantar rod and the foot dependent the flat pose is nearly singular."""
    found = partition(with_other_hints(cassie))
    assert [cassie.closure_names[i] for i in found.dropped_conditions(cassie)] == ["loop_right_plantar_foot_joint.l3"]


def test_the_second_way_is_that_of_the_model(cassie):
    names = list(cassie.coordinate_names)
    for q in drawn(names, "any", 3, seed=1):
        position, _ = closure(cassie, q, np.zeros(cassie.nu))
        for loop, rows in zip(cassie.loops, position.reshape(-1, 3), strict=True):
            own = PointLoop(cassie, loop)
            x = q[[names.index(n) for n in own.names]]
            r, J = own.gap(x[None])
            parts = np.linalg.norm(r) / np.linalg.norm(rows)
            assert np.isclose(np.log2(parts) % 1, 0) or np.isclose(
                np.log2(parts) % 1, 1
            )  # of the characteristic length
            moved = [own.gap((x + sign * 1e-6 * e)[None])[0][0] for e in np.eye(len(x)) for sign in (1, -1)]
            assert np.allclose(J[0].T, (np.array(moved[::2]) - moved[1::2]) / 2e-6, atol=1e-8)


@pytest.mark.parametrize("ranges", RANGES)
def test_nine_of_ten_random_states_are_assembled_if_they_can_be_closed_at_all(cassie, chosen, ranges):
    q = drawn(cassie.coordinate_names, ranges, 25, seed=11)
    held = {cassie.coordinate_names[i] for i in independent_coordinates(cassie, chosen)}
    possible = can_close(cassie, held, q)
    assert 0.5 < np.mean(possible) < 0.9
    for guess in ("whole", "initial"):
        found = assembled(cassie, chosen, q, guess)
        assert not np.any(found & ~possible)
        assert np.sum(found) >= 0.9 * np.sum(possible)


def test_nine_of_ten_random_states_are_assembled_with_better_independents(cassie):
    """Of all states, that is: with these nearly all can be closed."""
    hinted = with_other_hints(cassie)
    chosen = partition(hinted)
    q = drawn(cassie.coordinate_names, "any", 40, seed=11)
    for guess in ("whole", "initial"):
        assert np.mean(assembled(hinted, chosen, q, guess)) >= 0.9


def leg():
    """The left leg from its hip on, with both of its loops."""
    text = FILE.read_text()
    head = re.search(r"^parameters:\n(?:  .*\n)*", text, re.M).group()
    blocks = re.findall(r"^  \w*left_\w+:\n(?:    .*\n)+", text, re.M)
    bodies = [b for b in blocks if "parent:" in b and "_hip_roll:\n" not in b and "_hip_yaw:\n" not in b]
    loops = [b for b in blocks if "from:" in b]
    text = f"model: leg\n{head}bodies:\n{''.join(bodies)}loops:\n{''.join(loops)}"
    return parse_model(text.replace("parent: left_hip_yaw", "parent: ground"))


def solved(solver, q, guess):
    """As `assembled`, by a generated solver."""
    names = list(solver.coordinate_names)
    kept = [names.index(name) for name in solver.independent_names]
    q0, u0 = solver.initial
    found = np.zeros(len(q))
    for i, state in enumerate(q):
        start = np.array(state if guess == "whole" else q0)
        start[kept] = state[kept]
        try:
            closed, u = solver.assemble(start, u0)
        except NotAssembled as error:
            # the initial state is followed, which another way to assemble the leg may not be reached from
            found[i] = np.nan if "its branch ends at" in str(error) else 0.0
            continue
        np.testing.assert_allclose(closed[kept], start[kept], rtol=0, atol=1e-15)  # quaternions get length one
        position, _ = solver.closure(closed, u)
        assert np.abs(position).max() < 1e-6
        assert np.array_equal(closed, solver.assemble(start, u0)[0])
        found[i] = 1.0
    return found


def test_a_generated_solver_assembles_a_leg_where_it_can_be_closed(tmp_path):
    model = leg()
    codegen.generate(model, tmp_path / "leg", functions=("assemble",))
    solver = codegen.load(tmp_path / "leg")
    q = drawn(solver.coordinate_names, "any", 30, seed=3)
    possible = can_close(model, set(solver.independent_names), q)
    assert 0.5 < np.mean(possible) < 0.95
    for guess in ("whole", "initial"):
        found = solved(solver, q, guess)
        followed = ~np.isnan(found)
        assert followed.all() or guess == "initial"
        assert not np.any(found[followed].astype(bool) & ~possible[followed])
        assert np.sum(found[followed]) >= 0.9 * np.sum(possible[followed])


@pytest.mark.campaign
def test_the_generated_solver_assembles_what_can_be_closed(cassie, tmp_path):
    report = codegen.generate(FILE, tmp_path / "cassie", check=True)
    assert 0 < max(report.errors.values()) < 1e-9
    solver = codegen.load(tmp_path / "cassie")
    for ranges in RANGES:
        q = drawn(cassie.coordinate_names, ranges, 100, seed=12)
        possible = can_close(cassie, set(solver.independent_names), q)
        for guess in ("whole", "initial"):
            found = solved(solver, q, guess)
            followed = ~np.isnan(found)
            assert followed.all() or guess == "initial"
            assert not np.any(found[followed].astype(bool) & ~possible[followed])
            assert np.sum(found[followed]) >= 0.9 * np.sum(possible[followed])


@pytest.mark.campaign
@pytest.mark.parametrize("ranges", RANGES)
def test_many_random_states_are_assembled_if_they_can_be_closed_at_all(cassie, chosen, ranges):
    q = drawn(cassie.coordinate_names, ranges, 100, seed=13)
    held = {cassie.coordinate_names[i] for i in independent_coordinates(cassie, chosen)}
    possible = can_close(cassie, held, q)
    for guess in ("whole", "initial"):
        found = assembled(cassie, chosen, q, guess)
        assert not np.any(found & ~possible)
        assert np.sum(found) >= 0.9 * np.sum(possible)
