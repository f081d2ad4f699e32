"""Scenes: poses of bodies from a package with frames, at any parameters, against the model and independent kinematics."""

import json
import pickle
from pathlib import Path

import numpy as np
import pytest

import ordernm
from codegen.runtime.standalone.display.picture import view_of
from codegen.runtime.standalone.display.poses import Poses, quaternions
from codegen.runtime.standalone.display.scene import scene_of
from codegen.runtime.standalone.display.views import single_coordinates

EXAMPLES = Path(__file__).parents[2] / "examples"

MODEL = """
model: shown
gravity: [0, 0, -9.81]
parameters: {length: 1.0, radius: 2 cm, tilt: 0.3}
bodies:
  bar:
    parent: ground
    joint: {type: revolute, axis: y, at: [0, 0, 2], rotate: [{axis: z, angle: tilt}]}
    shape: {type: cylinder, axis: x, length: length, radius: radius, mass: 1, center: [length/2, 0, 0]}
  slider:
    parent: bar
    joint: {type: prismatic, axis: x, at: [length, 0, 0]}
    mass: 1
    com: [0.1, 0, 0]
    visuals:
    - {type: box, size: [10 cm, 2*radius, "max(radius, 3 cm)"], at: [length/4, 0, 0], rpy: [0, 0, tilt], color: "#4477AA80"}
    - {type: mesh, file: part.stl, scale: 0.5}
  plain: {parent: slider, joint: {type: revolute, axis: y, at: [0.2, 0, 0]}, mass: 1, com: [0, 0, -0.3]}
  hidden: {parent: plain, joint: {type: fixed, at: [0, 0, -0.5]}, mass: 1, visuals: []}
visuals:
- {type: box, size: [1, 1, 2*radius], at: [0, 0, -radius]}
points:
  tip: {body: hidden, at: [0, 0, -0.1]}
forces:
  coil: {type: spring, from: {body: ground, at: [1, 0, 2]}, to: tip, stiffness: 10, free_length: 0.1}
initial: {q: {bar: 0.4, slider: 0.1, plain: -0.2}}
"""


@pytest.fixture(scope="module")
def solver(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scene") / "shown"
    ordernm.generate(ordernm.parse_model(MODEL), folder, target="numpy", frames=True)
    return ordernm.load(folder, target="numpy")


def scene(solver, **p):
    manifest = json.loads((solver.folder / "model.json").read_text())
    parameters = dict(zip(solver.parameter_names, solver.parameters, strict=True)) | p
    return scene_of(manifest, np.array([parameters[n] for n in solver.parameter_names]))


def test_sizes_and_places_follow_the_parameters(solver):
    rod, box, mesh, floor = scene(solver, length=2.0, radius=0.05).solids
    assert rod.type == "cylinder"
    np.testing.assert_allclose(rod.sizes, [0.05, 2.0])
    np.testing.assert_allclose(rod.at, [1.0, 0, 0])
    np.testing.assert_allclose(rod.rotation @ [0, 0, 1], [1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(box.sizes, [0.1, 0.1, 0.05])
    np.testing.assert_allclose(box.at, [0.5, 0, 0])
    c, s = np.cos(0.3), np.sin(0.3)
    np.testing.assert_allclose(box.rotation, [[c, -s, 0], [s, c, 0], [0, 0, 1]], atol=1e-15)
    assert box.color == "#4477aa80"
    assert (floor.body, floor.sizes.tolist(), floor.at.tolist()) == (-1, [1, 1, 0.1], [0, 0, -0.05])
    assert (mesh.file, mesh.sizes.tolist(), box.body, mesh.body) == ("part.stl", [0.5] * 3, 1, 1)


def test_bodies_without_visuals_are_lines_and_hidden_ones_are_not(solver):
    found = scene(solver)
    assert [x.name for x in found.sticks] == ["plain"]
    np.testing.assert_allclose(found.sticks[0].ends, [[0, 0, 0], [0, 0, -0.5]])
    assert [x.name for x in found.rails] == ["slider"]
    assert [(x.name, x.bodies) for x in found.elements] == [("coil", (-1, 3))]
    assert [(m.name, m.body) for m in found.points] == [("tip", 3)]


def test_poses_of_a_picture_are_those_of_independent_kinematics(solver):
    q, _ = solver.initial
    poses = solver._views._poses(q[None], np.zeros(3), solver.parameters, np.zeros(0), np.zeros(1))
    a, b, x, tilt = q[0], q[0] + q[2], 1.0 + q[1], 0.3
    turn = np.array([[np.cos(tilt), -np.sin(tilt), 0], [np.sin(tilt), np.cos(tilt), 0], [0, 0, 1]])
    slide, drop = np.array([np.cos(a), 0, -np.sin(a)]), np.array([np.sin(b), 0, np.cos(b)])
    tip = np.array([0, 0, 2]) + turn @ ((x + 0.2) * slide - 0.6 * drop)
    np.testing.assert_allclose(poses.of(3, np.array([0, 0, -0.1]), 0), tip, atol=1e-14)


def test_a_view_is_along_the_normal_of_a_planar_mechanism(solver):
    q, p = solver.initial[0][None], np.array(solver.parameters)
    poses = solver._views._poses(q, np.zeros(3), p, np.zeros(0), np.zeros(1))
    straight = solver._views._poses(
        q, np.zeros(3), np.where(np.array(solver.parameter_names) == "tilt", 0.0, p), np.zeros(0), np.zeros(1)
    )
    assert view_of("auto", scene(solver, tilt=0.0), straight) == view_of("y", scene(solver), poses)
    assert view_of("auto", scene(solver), poses) == view_of("corner", scene(solver), poses)
    with pytest.raises(ValueError, match="view is 'top'; x, y, z, corner and auto are allowed"):
        view_of("top", scene(solver), poses)


def test_a_mesh_that_is_not_there_is_a_cube_with_one_warning(solver, tmp_path):
    pytest.importorskip("matplotlib")
    with pytest.warns(
        RuntimeWarning, match="mesh part.stl is not a file in .*; a cube of 0.05 m is shown instead"
    ) as caught:
        solver.picture(solver.initial[0], path=tmp_path / "a.png", folder=tmp_path)
    assert len(caught) == 1
    with pytest.warns(RuntimeWarning):
        solver.picture(solver.initial[0], path=tmp_path / "b.png", folder=tmp_path)
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_a_mesh_of_a_file_has_its_scale_and_place(solver, tmp_path):
    trimesh = pytest.importorskip("trimesh")
    from codegen.runtime.standalone.display.meshes import Meshes

    trimesh.creation.box((2, 4, 6)).export(tmp_path / "part.stl")
    vertices, faces = Meshes(tmp_path).surface(scene(solver).solids[2])
    np.testing.assert_allclose(vertices.max(axis=0), [0.5, 1.0, 1.5])
    assert len(faces) == 12


def test_motions_are_animated_and_loaded_ones_with_a_solver(solver, tmp_path):
    pytest.importorskip("PIL")
    from PIL import Image

    pytest.importorskip("trimesh").creation.box((1, 1, 1)).export(tmp_path / "part.stl")
    rows = np.linspace(0, 0.2, 6)
    q, u = np.tile(solver.initial[0], (6, 1)), np.zeros((6, 3))
    q[:, 0] += rows
    names = {"coordinate_names": solver.coordinate_names, "speed_names": solver.speed_names}
    run = ordernm.Trajectory("shown", rows, q, u, **names, parameter_names=solver.parameter_names)
    with pytest.raises(ValueError, match="has no solver with frames; generate the package with frames"):
        run.animate(tmp_path / "run.gif")
    with pytest.raises(ValueError, match=r"run.mp4 ends in .mp4; animations are written as .gif or .png"):
        run.animate(tmp_path / "run.mp4", solver, folder=tmp_path)
    run.animate(tmp_path / "run.gif", solver, folder=tmp_path)
    with Image.open(tmp_path / "run.gif") as image:
        assert image.n_frames == 6
        assert image.info["duration"] == 40
    other = ordernm.Trajectory("other", rows, q, u, **names, parameter_names=solver.parameter_names)
    with pytest.raises(ValueError, match=r"the trajectory is of model other .*; the solver is of shown"):
        other.animate(tmp_path / "run.gif", solver)
    assert pickle.loads(pickle.dumps(run)).views is None


def test_long_motions_are_thinned_with_a_warning(solver):
    n = 1_000_000
    q, u = np.broadcast_to(solver.initial[0], (n, 3)), np.broadcast_to(np.zeros(3), (n, 3))
    names = {"coordinate_names": solver.coordinate_names, "speed_names": solver.speed_names}
    run = ordernm.Trajectory("shown", np.arange(n), q, u, **names, parameter_names=solver.parameter_names)
    with pytest.warns(RuntimeWarning, match="the motion has 1000000 results; 10000 of them are shown"):
        _, poses = solver._views.of_motion(run).shown(run)
    assert poses.rotation.shape == (10_000, 4, 3, 3)
    assert (poses.t[0], poses.t[-1]) == (0.0, n - 1)


def test_a_package_without_frames_has_no_views(tmp_path):
    model = ordernm.parse_model(MODEL)
    ordernm.generate(model, tmp_path / "bare", target="numpy")
    bare = ordernm.load(tmp_path / "bare", target="numpy")
    assert "display" not in json.loads((tmp_path / "bare" / "model.json").read_text())
    assert not (tmp_path / "bare" / "_runtime" / "display").exists()
    with pytest.raises(AttributeError, match="shown was generated without picture: generate it with --frames"):
        bare.picture(bare.initial[0])
    with pytest.raises(ValueError, match="has no frames; generate the package with frames"):
        ordernm.Trajectory("shown", [], np.empty((0, 3)), np.empty((0, 3)), coordinate_names=bare.coordinate_names,
                           speed_names=bare.speed_names).animate("x.gif", bare)  # fmt: skip


def test_poses_are_of_all_bodies():
    poses = Poses(np.zeros(1), np.eye(3)[None, None], np.ones((1, 1, 3)))
    np.testing.assert_allclose(poses.of(0, np.zeros(3), 0), np.ones(3))
    np.testing.assert_allclose(poses.of(-1, np.ones(3), 0), np.ones(3))


def test_quaternions_turn_as_their_matrices():
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(5)
    whole = [Rotation.from_rotvec(np.pi * np.eye(3)[k]) for k in range(3)]
    turns = Rotation.concatenate([Rotation.identity(1), *whole, Rotation.random(200, random_state=rng)])
    found = quaternions(turns.as_matrix())
    back = Rotation.from_quat(found[:, [1, 2, 3, 0]]).as_matrix()
    np.testing.assert_allclose(back, turns.as_matrix(), atol=1e-14)


def test_shades_are_the_lengths_of_derivatives_of_centres_of_mass(solver):
    q, p, h = solver.initial[0][None], np.array(solver.parameters), 1e-6
    found = solver._views._shades(
        scene(solver), q, p, np.zeros(0), np.zeros(1), np.zeros((3, 1, 3)), solver.parameter_names
    )

    def centres(p):
        poses = solver._views._poses(q, np.zeros(3), p, np.zeros(0), np.zeros(1))
        return np.stack([poses.of(k, c, 0) for k, c in enumerate(scene(solver).centres)])

    for j, name in enumerate(solver.parameter_names):
        step = h * np.eye(3)[j]
        along = (centres(p + step) - centres(p - step)) / (2 * h)
        np.testing.assert_allclose(found[name][0], np.linalg.norm(along, axis=1), atol=1e-8)


def test_a_motion_is_computed_again_at_other_parameters(tmp_path):
    ordernm.generate(ordernm.parse_model(MODEL), tmp_path / "moved", functions=("simulate", "frames"))
    moved = ordernm.load(tmp_path / "moved")
    times = np.linspace(0, 0.2, 5)
    p = np.array(moved.parameters) * 1.5
    again = moved.simulate(times, sensitivities="length").views.again(p)
    expected = moved.simulate(times, p=p, sensitivities="length")
    np.testing.assert_array_equal(again.q, expected.q)
    np.testing.assert_array_equal(again.dq, expected.dq)
    shown = again.views.shown(again)
    np.testing.assert_allclose(shown[0].solids[0].sizes, [0.03, 1.5])


def test_ends_of_loops_are_those_of_the_file_also_where_the_generator_exchanges_them():
    from codegen.display import display

    model = ordernm.load_model(EXAMPLES / "four_bar.yaml")
    assert display(model.with_turned([0]))["loops"] == display(model)["loops"]


def test_places_may_have_remainders_and_tables(tmp_path):
    text = MODEL.replace("at: [0.2, 0, 0]}", 'at: ["mod(5*length, 0.3)", 0, 0]}')
    ordernm.generate(ordernm.parse_model(text), tmp_path / "shown", target="numpy", frames=True)
    found = scene(ordernm.load(tmp_path / "shown", target="numpy"), length=1.01).joints[2]
    np.testing.assert_allclose(found.at, [5.05 % 0.3, 0, 0], atol=1e-14)


def test_colours_of_derivatives_that_do_not_exist_are_black():
    from codegen.runtime.standalone.display.viewer import _scale

    assert _scale(np.array([np.nan]))[0].tolist() == [0, 0, 0]
    assert _scale(np.array([0.0]))[0].any()


def test_rates_of_animations_are_positive(solver, tmp_path):
    names = {"coordinate_names": solver.coordinate_names, "speed_names": solver.speed_names}
    run = ordernm.Trajectory("shown", [0.0], np.zeros((1, 3)), np.zeros((1, 3)), **names,
                             parameter_names=solver.parameter_names)  # fmt: skip
    with pytest.raises(ValueError, match="rate is 0; a positive number of frames per second is needed"):
        run.animate(tmp_path / "run.gif", solver, rate=0)


@pytest.mark.parametrize("name", ["satellite", "quadrotor"])
def test_sliders_move_every_coordinate_but_those_of_quaternions(name, tmp_path):
    ordernm.generate(
        EXAMPLES / f"{name}.yaml", tmp_path / name, target="numpy", functions="accelerations", compile=False
    )
    solver = ordernm.load(tmp_path / name)
    moved = single_coordinates(solver, solver._manifest["quaternions"])
    components = {n for n in solver.coordinate_names if n.endswith((".qw", ".qx", ".qy", ".qz"))}
    assert set(moved) == set(solver.independent_names) - components
    assert any(n.endswith(".px") for n in moved)
