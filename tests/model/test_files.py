# ruff: noqa: E501  (tables of mistakes)
"""Models in several files, by inclusion and by submodels, against the same model in one file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import codegen
from codegen.model import Model, ModelBuilder, ModelError, load_model, parse_model
from codegen.reference import DenseEngine

LEG = """\
model: leg
gravity: [0, 0, -1]
constants: {side: 1, n: 2}
parameters: {length: 0.3, spread: 0.05}
inputs: [torque]
bodies:
  hip:
    parent: ground
    joint: {type: universal, axes: [x, y], at: [0.01, 0, 0]}
    mass: 1
    com: [0, side*spread, -length/2]
    inertia: {xx: 0.01, yy: 0.01, zz: 0.004}
  repeat k in 1..n:
    shin(k):
      parent: shin(k-1)
      joint: {type: revolute, axis: y, at: [0, 0, -length]}
      shape: {type: capsule, axis: z, length: length, radius: 0.02, mass: 0.5, center: [0, 0, -length/2]}
      first: {parent: hip}
points:
  foot: {body: shin(n), at: [0, 0, -length]}
forces:
  drive: {type: joint, joint: hip, value: [torque - 0.1*u.hip.1, -0.1*u.hip.2]}
  rope: {type: spring, from: foot, to: {body: ground, at: [0, 0, 0.2]}, stiffness: 40, free_length: length}
  wind: {type: force, on: foot, value: [-velocity.foot.x, position.foot.z, 0]}
initial: {q: {hip.2: 0.3, shin_1: -0.6}}
outputs:
  height: {position: foot, axis: z}
"""

WALKER = """\
model: walker
gravity: [0, 0, -9.81]
constants: {y_left: 0.2, y_right: -0.2, side_left: 1, side_right: -1}
parameters: {thigh: 0.31, tilt: 0.2}
inputs: [push]
bodies:
  hull: {parent: ground, joint: {type: free}, shape: {type: box, size: [1, 0.3, 0.2], mass: 12}}
submodels:
  repeat s in left, right:
    leg(s):
      use: parts/leg.yaml
      on: hull
      at: [0.4, y(s), 0]
      rpy: [0, tilt, 0]
      with: {side: side(s), length: 2*thigh/2, torque: push + sin(t)}
outputs:
  height: {position: hull, axis: z}
  knee: {value: q.leg_left_shin_1 + u.leg_right_hip.2}
"""


def by_hand() -> Model:
    """The walker as a single file."""
    b = ModelBuilder("walker", gravity=[0, 0, -9.81])
    thigh, tilt = b.parameter("thigh", 0.31), b.parameter("tilt", 0.2)
    push = b.input("push")
    hull = b.body("hull", "ground", "free", shape={"type": "box", "size": [1, 0.3, 0.2], "mass": 12})
    for s, y, side in (("left", 0.2, 1), ("right", -0.2, -1)):
        spread = b.parameter(f"leg_{s}_spread", 0.05)
        mount = b.body(f"leg_{s}", hull, "fixed", at=[0.4, y, 0], rpy=[0, tilt, 0])
        body = hip = b.body(
            f"leg_{s}_hip", mount, "universal", axes=["x", "y"], at=[0.01, 0, 0], mass=1,
            com=[0, side * spread, -thigh / 2], inertia={"xx": 0.01, "yy": 0.01, "zz": 0.004},
        )  # fmt: skip
        shape = {
            "type": "capsule",
            "axis": "z",
            "length": thigh,
            "radius": 0.02,
            "mass": 0.5,
            "center": [0, 0, -thigh / 2],
        }
        for k in (1, 2):
            body = b.body(f"leg_{s}_shin_{k}", body, axis="y", at=[0, 0, -thigh], shape=shape)
        foot = b.point(f"leg_{s}_foot", body, [0, 0, -thigh])
        b.joint_force(f"leg_{s}_drive", hip, [f"{push} + sin(t) - 0.1*u.{hip}.1", f"-0.1*u.{hip}.2"])
        ends = {"start": foot, "end": {"body": mount, "at": [0, 0, 0.2]}}
        b.force(f"leg_{s}_rope", "spring", **ends, stiffness=40, free_length=thigh)
        b.force(f"leg_{s}_wind", "force", on=foot, value=[f"-velocity.{foot}.x", f"position.{foot}.z", 0])
        b.output(f"leg_{s}_height", {"position": foot, "axis": "z"})
    b.output("height", {"position": hull, "axis": "z"})
    b.output("knee", {"value": "q.leg_left_shin_1 + u.leg_right_hip.2"})
    return b.build()


def written(folder: Path, **files: str) -> Path:
    (folder / "parts").mkdir(exist_ok=True)
    for name, text in files.items():
        (folder / f"{name.replace('__', '/')}.yaml").write_text(text)
    return folder


def test_submodels_are_what_stands_in_one_file(tmp_path: Path) -> None:
    model = load_model(written(tmp_path, walker=WALKER, parts__leg=LEG) / "walker.yaml")
    other = by_hand()
    assert model.coordinate_names == other.coordinate_names
    assert (
        set(model.parameter_names)
        == set(other.parameter_names)
        == {"thigh", "tilt", "leg_left_spread", "leg_right_spread"}
    )
    assert model.inputs == ("push",)
    assert {o.name for o in model.outputs} == {o.name for o in other.outputs}
    rng = np.random.default_rng(3)
    one, two = DenseEngine(model), DenseEngine(other)
    q = rng.normal(size=model.nq)
    q[3:7] /= np.linalg.norm(q[3:7])
    u, inputs, p = rng.normal(size=model.nu), [0.7], [0.31, 0.2, 0.06, 0.04]
    order = [other.parameter_names.index(n) for n in model.parameter_names]
    mine = one.accelerations(q, u, p, inputs, 0.4)
    theirs = two.accelerations(q, u, np.array(p)[np.argsort(order)], inputs, 0.4)
    assert np.abs(mine - theirs).max() <= 1e-12 * np.abs(theirs).max()
    along = one.jacobians(q, u, p, inputs, 0.4).p[:, np.argsort(order)]
    assert (
        np.abs(along - two.jacobians(q, u, np.array(p)[np.argsort(order)], inputs, 0.4).p).max()
        <= 1e-11 * np.abs(along).max()
    )


def test_the_builder_makes_the_same(tmp_path: Path) -> None:
    written(tmp_path, walker=WALKER, parts__leg=LEG)
    b = ModelBuilder("walker", gravity=[0, 0, -9.81], folder=tmp_path)
    thigh, tilt = b.parameter("thigh", 0.31), b.parameter("tilt", 0.2)
    push = b.input("push")
    hull = b.body("hull", "ground", "free", shape={"type": "box", "size": [1, 0.3, 0.2], "mass": 12})
    for s, side in (("left", 1), ("right", -1)):
        given = {"side": side, "length": thigh, "torque": push + "sin(t)"}
        b.submodel(f"leg_{s}", "parts/leg.yaml", hull, at=[0.4, 0.2 * side, 0], rpy=[0, tilt, 0], given=given)
    b.output("height", {"position": hull, "axis": "z"})
    b.output("knee", {"value": "q.leg_left_shin_1 + u.leg_right_hip.2"})
    assert b.build().parameter_names == load_model(tmp_path / "walker.yaml").parameter_names


def test_a_generated_submodel_agrees_with_the_dense_method(tmp_path: Path) -> None:
    model = load_model(written(tmp_path, walker=WALKER, parts__leg=LEG) / "walker.yaml")
    codegen.generate(model, tmp_path / "walker", target="numpy")
    solver = codegen.load(tmp_path / "walker")
    q, u = solver.initial
    u = u + 0.3
    mine, theirs = solver.jacobians(q, u, None, [0.2], 0.3), DenseEngine(model).jacobians(q, u, None, [0.2], 0.3)
    assert np.abs(mine.p - theirs.p).max(axis=0) == pytest.approx(0, abs=1e-11 * np.abs(theirs.p).max())
    assert np.abs(mine.inputs - theirs.inputs).max() <= 1e-12 * np.abs(theirs.inputs).max()


INCLUDING = """\
model: one
include: [materials.yaml, parts/arm.yaml]
parameters: {length: 0.4}
outputs: {end: {position: {body: arm, at: [0, 0, -length]}, axis: z}}
"""
MATERIALS = "constants: {steel: 7850 kg/m**3, rho: steel/2}\ngravity: [0, 0, -9.81]\n"
ARM = """\
bodies:
  arm:
    parent: ground
    joint: {type: revolute, axis: y}
    shape: {type: cylinder, axis: z, length: length, radius: 2 cm, density: rho, center: [0, 0, -length/2]}
"""


def test_included_files_are_read_as_if_they_stood_there(tmp_path: Path) -> None:
    model = load_model(written(tmp_path, one=INCLUDING, materials=MATERIALS, parts__arm=ARM) / "one.yaml")
    assert model.gravity is not None and len(model.files) == 2
    mass = model.bodies[0].mass.evaluate(model.defaults)
    assert mass == pytest.approx(3925 * np.pi * 0.02**2 * 0.4, rel=1e-14)


def test_a_submodel_is_given_what_its_own_number_is_whatever_that_is_called(tmp_path: Path) -> None:
    """A rod's density is by length; `mass` and `density` are names like any other there."""
    rod = """\
model: rod
constants: {density: 3 kg/m, mass: 4 m}
bodies:
  rod:
    parent: ground
    joint: {type: revolute, axis: y}
    shape: {type: rod, axis: z, length: mass, density: density}
"""
    two = (
        "model: two\ngravity: [0, 0, -9.81]\nsubmodels: {left: {use: rod.yaml, with: {density: 2 kg/m, mass: 50 cm}}}\n"
    )
    model = load_model(written(tmp_path, two=two, rod=rod) / "two.yaml")
    assert model.bodies[-1].mass.evaluate(model.defaults) == 1.0
    wrong = two.replace("2 kg/m", "2 kg/m**3")
    with pytest.raises(ModelError, match=r"a mass per length \(kg/m\) is needed"):
        load_model(written(tmp_path, two=wrong, rod=rod) / "two.yaml")


def test_a_submodel_may_include_and_have_submodels(tmp_path: Path) -> None:
    inner = "model: inner\nparameters: {size: 1.5}\n" + ARM.replace("length: length", "length: size").replace(
        "length/2", "size/2"
    )
    middle = "model: middle\ninclude: [../materials.yaml]\nparameters: {a: 2}\nsubmodels: {x: {use: inner.yaml, with: {size: 3*a}}}\n"
    inner = inner.replace("density: rho", "density: 2000")
    outer = "model: outer\nparameters: {b: 5}\nsubmodels: {m: {use: parts/middle.yaml, with: {a: b + 1}}, n: {use: parts/middle.yaml}}\n"
    written(tmp_path, outer=outer, materials=MATERIALS, parts__middle=middle, parts__inner=inner)
    model = load_model(tmp_path / "outer.yaml")
    assert [b.name for b in model.bodies] == ["m", "n", "m_x", "m_x_arm", "n_x", "n_x_arm"]
    assert model.parameter_names == ("b", "n_a")
    masses = [b.mass.evaluate(model.defaults) for b in model.bodies]
    assert masses[3] == pytest.approx(3 * masses[5]) and model.gravity is None


def test_a_package_tells_that_another_of_its_files_changed(tmp_path: Path) -> None:
    one = written(tmp_path, one=INCLUDING, materials=MATERIALS, parts__arm=ARM) / "one.yaml"
    codegen.generate(one, tmp_path / "package", target="numpy", functions="accelerations")
    solver = codegen.load(tmp_path / "package")
    assert solver.in_precision(30, one) is not None
    written(tmp_path, materials=MATERIALS.replace("7850", "7800"))
    with pytest.raises(ValueError, match="changed since"):
        codegen.load(tmp_path / "package").in_precision(40, one)


def mistakes(folder: Path) -> list[str]:
    with pytest.raises(ModelError) as info:
        load_model(folder / "walker.yaml")
    return [line.replace(f"{folder}/", "") for line in str(info.value).splitlines()]


@pytest.mark.parametrize(
    ("file", "old", "new", "expected"),
    [
        ("walker", "parts/leg.yaml", "parts/log.yaml", "walker.yaml:11:12: submodels.leg(s).use: file 'parts/log.yaml' does not exist; * did you mean 'leg.yaml'?"),
        ("walker", "parts/leg.yaml", "legs/leg.yaml", "walker.yaml:11:12: submodels.leg(s).use: file 'legs/leg.yaml' does not exist; its folder does not exist"),
        ("walker", "parts/leg.yaml", "../leg.yaml", "walker.yaml:11:12: submodels.leg(s).use: '../leg.yaml' leaves the model's folder"),
        ("walker", "parts/leg.yaml", "/etc/passwd", "walker.yaml:11:12: submodels.leg(s).use: '/etc/passwd' is not a path within"),
        ("walker", "parts/leg.yaml", "[1]", "walker.yaml:11:12: submodels.leg(s).use: a list of 1; give a file"),
        ("walker", "parts/leg.yaml", "parts", "walker.yaml:11:12: submodels.leg(s).use: file 'parts' does not exist"),
        ("walker", "on: hull", "on: hul", "walker.yaml:12:11: submodels.leg(s).on: unknown body 'hul'; *hull, leg_left,* (s = left)"),
        ("walker", "length: 2*thigh/2", "lenght: thigh", "walker.yaml:15:29: submodels.leg(s).with.lenght: parts/leg.yaml has no constant, parameter or input 'lenght'; * did you mean 'length'?"),
        ("walker", "length: 2*thigh/2", "length: thig", "walker.yaml:15:37: submodels.leg(s).with.length: unknown name 'thig'; * did you mean 'thigh'?"),
        ("walker", "length: 2*thigh/2", "length: push", "walker.yaml:15:37: submodels.leg(s).with.length: unknown name 'push'"),
        ("walker", "side: side(s)", "side: thigh", "walker.yaml:15:20: submodels.leg(s).with.side: unknown name 'thigh'; constants written before it:"),
        ("walker", "      use: parts/leg.yaml\n", "", "walker.yaml:11:7: submodels.leg(s): key 'use' is missing"),
        ("leg", "com: [0, side*spread", "com: [0, side*spred", "parts/leg.yaml:11:19: bodies.hip.com[1]: unknown name 'spred'; * did you mean 'spread'? (in leg_left)"),
        ("leg", "com: [0, side*spread", "com: [0, thigh", "parts/leg.yaml:11:14: bodies.hip.com[1]: unknown name 'thigh'"),
        ("leg", "joint: hip,", "joint: hip1,", "parts/leg.yaml:22:31: forces.drive.joint: unknown joint"),
        ("leg", "mass: 1\n", "mas: 1\n", "parts/leg.yaml:10:5: bodies.hip.mas: unknown key"),
        ("leg", "mass: 1\n", "mass: 1: 2\n", "parts/leg.yaml:10:12: this is not YAML"),
        ("leg", "points:", "point:", "parts/leg.yaml:19:1: point: unknown key 'point'; * 'points'?"),
        ("leg", LEG, "- a\n", "parts/leg.yaml:1:1: a file of a model must be a mapping"),
        ("leg", "model: leg\n", "include: [leg.yaml]\n", "parts/leg.yaml:1:11: include[0]: files read each other in a circle, parts/leg.yaml -> parts/leg.yaml"),
        ("leg", "model: leg\n", "submodels: {x: {use: ../walker.yaml}}\n", "parts/leg.yaml:1:22: submodels.x.use: files read each other in a circle"),
        ("walker", "model: walker\n", "model: walker\ninclude: parts/leg.yaml\n", "walker.yaml:2:10: include: 'parts/leg.yaml'; a list of files is needed"),
        ("walker", "model: walker\n", "model: walker\ninclude: [parts/leg.yaml]\n", "walker.yaml:3:1: gravity: gravity is already given in parts/leg.yaml"),
    ],
)  # fmt: skip
def test_mistakes_name_their_file(tmp_path: Path, file: str, old: str, new: str, expected: str) -> None:
    texts = {"walker": WALKER, "leg": LEG}
    assert old in texts[file]
    texts[file] = texts[file].replace(old, new, 1)
    found = mistakes(written(tmp_path, walker=texts["walker"], parts__leg=texts["leg"]))
    start, *others = expected.split("*")
    assert any(line.startswith(start.rstrip()) and all(o.strip() in line for o in others) for line in found), "\n".join(
        found
    )
    assert len({line.partition(" (in ")[0] for line in found}) == len(found), "the same is said of each leg"


def test_a_text_has_no_files(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="comes from no file"):
        parse_model(WALKER)
    written(tmp_path, parts__leg=LEG)
    assert parse_model(WALKER, folder=tmp_path).nu == 6 + 2 * 4


def test_a_link_out_of_the_folder_is_refused(tmp_path: Path) -> None:
    inside = tmp_path / "inside"
    inside.mkdir()
    written(inside, walker=WALKER)
    (tmp_path / "leg.yaml").write_text(LEG)
    (inside / "parts" / "leg.yaml").symlink_to(tmp_path / "leg.yaml")
    assert "leaves the model's folder" in mistakes(inside)[0]


def test_files_that_use_each_other_twice_end(tmp_path: Path) -> None:
    for k in range(20):
        text = f"model: m{k}\nsubmodels: {{a: {{use: m{k + 1}.yaml}}, b: {{use: m{k + 1}.yaml}}}}\n"
        (tmp_path / f"m{k}.yaml").write_text(text)
    (tmp_path / "m20.yaml").write_text("model: m20\n")
    with pytest.raises(ModelError, match="uses of files"):
        load_model(tmp_path / "m0.yaml")
