"""The declarations of every joint type (names, keys, degrees of freedom, closure), and joints in model files."""

from random import Random

import numpy as np
import pytest
from joint_types import OTHERS, Polar, every_type, given_axes, known_types, one_body

from codegen.model import ModelError, parse_model
from codegen.model.joints import JOINTS, JointType
from codegen.model.mobility import _freedoms
from codegen.model.model import joint_coordinates
from codegen.model.motions import Displacement, Turn

__all__ = ["known_types"]

CARRYING = [kind for kind in JOINTS.values() if kind.carries]
CLOSING = [kind for kind in JOINTS.values() if kind.closure]


def keys_of(kind: type[JointType], rng: np.random.Generator) -> str:
    """The keys of a joint's entry other than its type."""
    text, axes = {}, given_axes(kind, rng)
    for (key, *place), axis in zip(kind.axis_keys, axes, strict=True):
        text[key] = [*text.get(key, []), axis] if place else axis
    text |= dict.fromkeys(kind.factor_keys, 0.5)
    return "".join(f", {key}: {value}" for key, value in text.items())


@every_type
def test_names_belong_to_the_motion(kind):
    model = one_body(kind, np.random.default_rng(0))
    assert (model.coordinate_names, model.speed_names) == joint_coordinates("b", kind.name)
    assert len(set(model.coordinate_names)) == model.nq == model.nu + len(kind.quaternions)
    assert all(name == "b" or name.startswith("b.") for name in (*model.coordinate_names, *model.speed_names))
    assert [model.coordinate_names[i] for _, p in model.quaternions for i in range(p.start, p.stop)] == [
        f"b.q{x}" for _ in model.quaternions for x in "wxyz"
    ]


def test_names_stay_what_models_use():
    """Models that people have written depend on these."""
    angles = (("b",), ("b",))
    known = {
        "fixed": ((), ()), "revolute": angles, "prismatic": angles, "universal": (("b.1", "b.2"), ("b.1", "b.2")),
        "spherical": (("b.qw", "b.qx", "b.qy", "b.qz"), ("b.wx", "b.wy", "b.wz")),
        "free": (("b.px", "b.py", "b.pz", "b.qw", "b.qx", "b.qy", "b.qz"),
                 ("b.wx", "b.wy", "b.wz", "b.vx", "b.vy", "b.vz")),
    }  # fmt: skip
    assert {name: joint_coordinates("b", name) for name in known} == known


@every_type
def test_motions_seen_by_the_check_of_mobility(kind):
    """Rank and size of the freedoms; their values are compared where a state can be chosen, in tests/loops."""
    model = one_body(kind, np.random.default_rng(1))
    turn, away, motions = _freedoms(model.bodies[0].joint, Random(2), lambda e: float(e.value))
    assert motions.shape == (6, model.nu)
    assert np.linalg.matrix_rank(motions, tol=1e-6) == model.nu
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-14)
    assert np.isfinite(away).all()


@pytest.mark.parametrize("kind", CLOSING, ids=lambda kind: kind.name)
def test_a_closure_leaves_the_freedoms_of_the_motion(kind):
    assert sum(kind.closure) == 6 - len(kind.speeds)


def test_a_displacement_comes_first():
    with pytest.raises(TypeError, match="first of its motions"):
        type(
            "Wrong", (JointType,), {"name": "wrong", "motion": (Turn(0, 0), Displacement(1, 1)), "__module__": __name__}
        )


@pytest.mark.parametrize("kind", CARRYING, ids=lambda kind: kind.name)
def test_a_file_makes_a_joint_of_every_type_that_carries(kind):
    keys = keys_of(kind, np.random.default_rng(3))
    text = f"""
model: m
bodies:
  a: {{parent: ground, joint: {{type: revolute, axis: y}}, mass: 1, inertia: {{xx: 1, yy: 1, zz: 1}}}}
  b: {{parent: a, joint: {{type: {kind.name}{keys}}}, mass: 1, inertia: {{xx: 1, yy: 1, zz: 1}}}}
"""
    joint = parse_model(text).bodies[1].joint
    assert joint.type == kind.name
    assert len(joint.factors) == len(kind.factor_keys)
    axes = {m.axis for m in kind.motion if hasattr(m, "axis")}
    assert len(joint.axes) >= len(axes)
    with pytest.raises(ModelError, match="unknown key 'axle'"):
        parse_model(text.replace(f"type: {kind.name}{keys}", f"type: {kind.name}{keys}, axle: y"))
    for key, *_ in kind.axis_keys:
        with pytest.raises(
            ModelError, match=rf"key '{key}' is missing; keys here: at, rotate, rpy, armature, type, {key}"
        ):
            parse_model(text.replace(keys, ""))


@pytest.mark.parametrize(
    ("kind", "name"), [(kind, name) for kind in CLOSING for name in (kind.name, *kind.synonyms)], ids=lambda x: str(x)
)
def test_a_file_makes_a_loop_of_every_type_that_closes(kind, name):
    model = parse_model(f"""
model: m
bodies:
  a: {{parent: ground, joint: {{type: free}}, mass: 1, inertia: {{xx: 1, yy: 1, zz: 1}}}}
loops:
  l: {{joint: {{type: {name}{keys_of(kind, np.random.default_rng(4))}}}, from: a, to: ground}}
""")
    (loop,) = model.loops
    assert (loop.type, loop.closure, len(loop.axes)) == (kind.name, kind.closure, len(kind.axis_keys))
    assert len(model.closure_names) == sum(kind.closure)


def test_what_does_not_close_a_loop_says_so():
    for kind in JOINTS.values():
        if not kind.closure:
            text = f"""
model: m
bodies: {{a: {{parent: ground, joint: {{type: free}}, mass: 1, inertia: {{xx: 1, yy: 1, zz: 1}}}}}}
loops: {{l: {{joint: {{type: {kind.name}}}, from: a, to: ground}}}}
"""
            with pytest.raises(ModelError, match=f"a {kind.name} joint {kind.closes_none}"):
                parse_model(text)


def test_types_of_the_tests_are_not_those_of_the_program():
    assert Polar.name in JOINTS  # while a test runs
    assert not OTHERS.keys() & {kind.name for kind in CARRYING + CLOSING}
