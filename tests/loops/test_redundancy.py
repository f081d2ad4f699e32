"""Nearly redundant conditions: the dropped ones, the messages, and the parameters that open redundant conditions."""

import numpy as np
import pytest
from loop_closure import assemble, closure

from codegen.loops import AssemblyError, PartitionError, describe, partition
from codegen.loops.dependents import condition
from codegen.loops.geometry import Geometry, padded
from codegen.loops.velocities import Motion
from codegen.model import parse_model
from codegen.reference import DenseEngine

FOUR_BAR = """
model: four_bar
{more}
parameters: {{shift: 0.0, coupler: 1.2}}
bodies:
  a: {{parent: ground, joint: {{type: revolute, axis: {axis}, rotate: [{{axis: {axis}, angle: 0.4}}]}}, mass: 1}}
  b: {{parent: a, joint: {{type: revolute, axis: {axis}, at: {arm_a}, rotate: [{{axis: x, angle: {tilt}}}]}}, mass: 1}}
  c: {{parent: b, joint: {{type: revolute, axis: {axis}, at: {arm_b}}}, mass: 1}}
loops:
  bearing: {{joint: {{{joint}}}, from: {{body: c, at: {arm_c}}}, to: {{body: ground, at: {base}}}}}
initial: {{q: {{a: -1.2, b: 0.4, c: 1.9}}}}
independent: [a]
"""
TILTS = (1e-12, 1e-10, 1e-9, 1e-8, 7.4e-8, 1e-6, 3.7e-6, 1e-5)
JOINTS = ("type: revolute, axis: y", "type: point", "type: universal, axes: [y, x]", "type: cylindrical, axis: y")


def four_bar(tilt=0.0, joint=JOINTS[0], offset="0", oblique=False, more=""):
    """A four-bar in the x-z plane; if `oblique`, with hinges along (1, 1, 1) and links along (1, -1, 0)."""
    arms = {"arm_a": "0.4", "arm_b": "coupler", "arm_c": "0.9", "base": "1.1"}
    for name, length in arms.items():
        across = f"[{length}*sqrt(0.5), -({length})*sqrt(0.5), 0]"
        arms[name] = across if oblique else f"[{length}, {offset if name == 'arm_b' else 0}, 0]"
    axis = "[1, 1, 1]" if oblique else "y"
    return parse_model(FOUR_BAR.format(tilt=tilt, joint=joint, axis=axis, more=more, **arms))


def dropped(model, chosen):
    return [model.closure_names[i] for i in chosen.dropped_conditions(model)]


@pytest.mark.parametrize("joint", JOINTS)
@pytest.mark.parametrize("tilt", TILTS)
def test_a_tilted_hinge_leaves_a_planar_loop_which_is_said(tilt, joint):
    model = four_bar(tilt, joint)
    chosen = partition(model)
    (ear,) = chosen.ears
    assert ear.rank == 2
    assert ear.rows - len(ear.dropped) == 2
    assert ear.gaps
    assert ear.condition < 3
    assert not chosen.warnings
    (said,) = chosen.remarks
    assert f"loop bearing taken as planar: axes agree to {tilt:.1e} rad; dropped" in said
    assert all(name in said for name in dropped(model, chosen))
    assert said in describe(model, chosen)
    q = np.array(chosen.q)
    for angle in np.linspace(0, 2 * np.pi, 10):
        q[0] = -1.2 + angle
        q = assemble(model, chosen, q)
        position, _ = closure(model, q, np.zeros(3))
        kept = [i for i, name in enumerate(model.closure_names) if name not in said]
        assert np.abs(position[kept]).max() < 1e-14
        assert 0.01 * tilt < np.abs(position).max() < 5 * tilt


def test_what_is_exact_is_as_it_was():
    for joint in JOINTS:
        chosen = partition(four_bar(0, joint))
        assert not chosen.ears[0].dropped
        assert not chosen.ears[0].gaps
        assert not chosen.opening
        assert not chosen.remarks


def test_a_tilt_beyond_the_tolerance_locks_and_a_tolerance_lets_it_go():
    with pytest.raises(PartitionError):
        partition(four_bar(1e-3, "type: point"))
    chosen = partition(four_bar(1e-3, "type: point", more="loop_tolerance: 2e-3"))
    assert "axes agree to 1.0e-03 rad" in chosen.remarks[0]
    with pytest.raises(PartitionError):
        partition(four_bar(1e-6, "type: point", more="loop_tolerance: 1e-8"))


def test_lengths_that_do_not_fit_by_little_are_taken_so():
    """An offset of a hinge along its axis: the closure matrix has rank 2 to rounding, only the position is open."""
    model = four_bar(offset="1e-7")
    chosen = partition(model)
    assert dropped(model, chosen) == ["bearing.l2", "bearing.a1", "bearing.a2"]
    assert "residual at the initial configuration 1.0e-07" in chosen.remarks[0]


@pytest.mark.parametrize("long", [0, 1e-9, 1e-6])
def test_a_structure_is_no_singular_start(long):
    """A triangle of bars on a hinge, welded: its joints cannot move, and its rank says so wherever it stands."""
    model = parse_model(f"""
model: truss
bodies:
  base: {{parent: ground, joint: {{type: revolute, axis: z}}, mass: 1}}
  a: {{parent: base, joint: {{type: revolute, axis: y}}, mass: 1}}
  tip: {{parent: a, joint: {{type: fixed, at: [1, 0, 0]}}, mass: 1}}
  b: {{parent: tip, joint: {{type: revolute, axis: y}}, mass: 1}}
loops:
  weld: {{joint: {{type: fixed}}, from: {{body: b, at: [{1 + long}, 0, 0]}},
         to: {{body: base, at: [1, 0, 0], rotate: [{{axis: y, angle: pi/3}}]}}}}
initial: {{q: {{a: -pi/3, b: 2*pi/3}}}}
""")
    chosen = partition(model)
    assert chosen.ears[0].rank == 2
    assert chosen.independent == (0,)
    assert len(dropped(model, chosen)) == (4 if long else 0)
    assert not chosen.warnings


def test_the_plane_may_lie_anywhere_in_the_faces():
    """Axes along (1, 1, 1) in all bodies: which of the linear conditions is dropped matters by the root of three at most."""
    oblique = four_bar(1e-7, "type: point", oblique=True)
    chosen = partition(oblique)
    assert len(chosen.ears[0].dropped) == 1
    assert chosen.ears[0].condition < 6


def spherical(offset):
    """Arcs of 0.8, 0.6, 0.5 and 0.7 rad; all axes through the origin, but for an offset of the second."""
    return parse_model(f"""
model: spherical_four_bar
bodies:
  a: {{parent: ground, joint: {{type: revolute, axis: z}}, mass: 1, com: [0.3, 0, 0]}}
  b: {{parent: a, joint: {{type: revolute, axis: [0, sin(0.6), cos(0.6)], at: [{offset}, 0, 0]}}, mass: 1, com: [0.3, 0, 0]}}
  c: {{parent: b, joint: {{type: revolute, axis: [0, sin(1.1), cos(1.1)]}}, mass: 1, com: [0.3, 0, 0]}}
loops:
  pin: {{joint: {{type: revolute, axis: z}}, from: {{body: c, rotate: [{{axis: x, angle: -1.8}}]}},
        to: {{body: ground, rotate: [{{axis: x, angle: -0.8}}]}}}}
initial: {{q: {{a: 0.5, b: 1.6, c: 1.6}}}}
""")


def test_axes_that_meet_in_a_point_but_for_a_little_are_taken_to_meet():
    model = spherical(1e-7)
    chosen = partition(model)
    assert chosen.ears[0].rank == 2
    assert dropped(model, chosen) == ["pin.l1", "pin.l2", "pin.l3"]
    assert "taken as spherical: axes meet in a point to" in chosen.remarks[0]


def test_the_conditions_that_stay_do_so_far_from_where_they_were_chosen():
    model = four_bar(1e-6)
    chosen = partition(model)
    geometry = Geometry(model)
    geometry.follow(chosen.ears[0])
    q = np.array(chosen.q)
    for angle in np.linspace(0, 2 * np.pi, 20):
        q[0] = -1.2 + angle
        q = assemble(model, chosen, q)
        matrix = Motion(geometry, padded(q), np.zeros((1, 3, 1))).closure([0])
        columns = [matrix.column[s] for s in chosen.ears[0].dependent]
        everything = Motion(geometry, padded(q), np.zeros((1, 3, 1))).closure([0], geometry.rows)
        whole = [everything.column[s] for s in chosen.ears[0].dependent]
        assert condition(matrix.E[..., columns]) < 1.5 * condition(everything.E[..., whole])


@pytest.mark.parametrize("joint", JOINTS[:2])
def test_parameters_that_open_a_loop_are_found(joint):
    chosen = partition(four_bar(0, joint, "shift"))
    assert [("shift", "coupler")[j] for j in chosen.opening] == ["shift"]
    assert chosen.ears[0].gaps
    assert not chosen.ears[0].dropped
    turned = partition(four_bar("shift", joint))
    assert [("shift", "coupler")[j] for j in turned.opening] == ["shift"]


def test_parameters_in_the_plane_open_little_where_the_plane_is_nearly_one():
    assert not partition(four_bar(1e-6)).opening


LOCKED = """
model: pushrod
bodies:
  a: {{parent: ground, joint: {{type: revolute, axis: y}}, mass: 1}}
  b: {{parent: a, joint: {{type: revolute, axis: y, at: [0.4, 0, 0], rotate: [{{axis: x, angle: {tilt}}}]}}, mass: 1}}
  c: {{parent: b, joint: {{type: revolute, axis: y, at: [1.2, 0, 0]}}, mass: 1}}
  other: {{parent: ground, joint: {{type: revolute, axis: z}}, mass: 1, com: [1, 0, 0]}}
loops:
  bearing: {{joint: {{type: point}}, from: {{body: c, at: [0.9, 0, 0]}}, to: {{body: ground, at: [1.1, {at}, 0]}}}}
initial: {{q: {{a: -1.2, b: 0.4, c: 1.9}}}}
"""


def test_motions_that_are_stopped_by_little_are_told():
    """A point off the plane by as much as the tilt allows: all three joints stand still, held by 1e-3 of what holds others."""
    model = parse_model(LOCKED.format(tilt=3e-3, at=-1e-3))
    chosen = partition(model)
    assert [model.speed_names[s] for s in chosen.independent] == ["other"]
    (warning,) = (x for x in chosen.warnings if "is blocked by" in x)
    assert "loop bearing: a motion of" in warning and "loop_tolerance" in warning
    assert f"warning: {warning}" in describe(model, chosen)
    loose = parse_model(LOCKED.format(tilt=3e-3, at=-1e-3) + "loop_tolerance: 1e-2\n")
    assert not any("is blocked by" in x for x in partition(loose).warnings)
    assert len(partition(loose).independent) == 2


def points_on_a_body(gap: float, count: int = 2) -> str:
    """A body on a ball joint that a free one carries, held by points as far apart on the ground as on it, but for a gap."""
    points = ((0.3, 0.4, -0.2), (-0.5, 0.1, 0.6), (0.2, -0.7, 0.1))[:count]
    loops = "".join(
        f"  l{i}: {{joint: {{type: point}}, from: {{body: b, at: [{x}, {y}, {z}]}}, "
        f"to: {{body: ground, at: [{x + 1 + gap * i!r}, {y!r}, {z - gap * i!r}]}}}}\n"
        for i, (x, y, z) in enumerate(points)
    )
    return (
        "model: held\ngravity: [0.3, 0.1, -9.81]\nbodies:\n"
        "  a: {parent: ground, joint: {type: free}, mass: 1, com: [0.1, 0, 0.2], inertia: {xx: 0.2, yy: 0.3, zz: 0.25}}\n"
        "  b: {parent: a, joint: {type: spherical, at: [1, 0, 0]}, mass: 2, com: [0, 0.1, 0], "
        "inertia: {xx: 0.2, yy: 0.3, zz: 0.25}}\nloops:\n" + loops
    )


@pytest.mark.parametrize("gap", [1e-9, 9e-8, 1e-6, 2e-5])
def test_points_that_a_rigid_body_holds_apart_may_be_off(gap):
    """The loops share every joint, so the second one has none of its own: it was refused at any tolerance."""
    found = []
    for off in (0.0, gap):
        model = parse_model(points_on_a_body(off))
        part = partition(model)
        assert len(part.independent) == 4
        assert bool(part.ears[0].dropped) == bool(off)
        engine = DenseEngine(model)
        found.append(engine.accelerations(part.q, np.zeros(model.nu)))
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=100 * gap)


def test_three_points_leave_no_freedom_whether_they_fit_or_not():
    """The gap was reported, which was not the reason."""
    text = (
        points_on_a_body(9e-8, 3)
        .replace("type: spherical", "type: revolute, axis: z")
        .replace("type: free", "type: fixed")
    )
    text = text.replace(
        "  a: {parent: ground, joint: {type: fixed}", "  a: {parent: ground, joint: {type: revolute, axis: x}"
    )
    with pytest.raises(PartitionError, match="no freedom left"):
        partition(parse_model(text))


def test_links_that_are_too_short_in_one_line_say_so():
    """The gap is within loop_tolerance, and a larger one would be no help."""
    text = (
        "model: line\nbodies:\n  a: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, com: [0.5, 0, 0]}\n"
        "  b: {parent: a, joint: {type: revolute, axis: y, at: [1, 0, 0]}, mass: 1, com: [0.5, 0, 0]}\n"
        "loops:\n  l: {joint: {type: point}, from: {body: b, at: [1, 0, 0]}, to: {body: ground, at: [2.00000009, 0, 0]}}\n"
    )
    with pytest.raises(
        AssemblyError, match=r"9e-08 m .* within loop_tolerance, 0\.0001, .* too short or too long by the residual"
    ):
        partition(parse_model(text))
