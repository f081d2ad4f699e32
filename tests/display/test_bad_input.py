"""Views of models that cannot be shown, and of very small, very large or invisible ones."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import ordernm

MODEL = """
model: swing
gravity: [0, 0, -9.81]
parameters: {length: LENGTH}
bodies:
  rod:
    parent: ground
    joint: {type: revolute, axis: y}
    mass: 1
    com: [0, 0, -length]
    visuals: VISUALS
initial: {q: {rod: 0.5}}
"""
ROD = "[{type: cylinder, radius: length/20, length: length, at: [0, 0, -length/2]}, {type: mesh, file: none.stl}]"


def made(folder, length="1.0", visuals=ROD):
    text = MODEL.replace("LENGTH", length).replace("VISUALS", visuals)
    ordernm.generate(ordernm.parse_model(text), folder / "swing", target="numpy", frames=True, check=False)
    return ordernm.load(folder / "swing", target="numpy")


@pytest.fixture(scope="module")
def solver(tmp_path_factory):
    return made(tmp_path_factory.mktemp("made"), visuals=ROD.partition(", {type: mesh")[0] + "]")


def motion(solver, q):
    q = np.asarray(q, float).reshape(-1, 1)
    names = {"coordinate_names": solver.coordinate_names, "speed_names": solver.speed_names}
    parameters = {"parameter_names": solver.parameter_names}
    return ordernm.Trajectory("swing", np.arange(len(q)) * 0.1, q, np.zeros(q.shape), **names, **parameters)


def test_states_that_are_not_finite_are_refused_by_their_place(solver, tmp_path):
    pytest.importorskip("viser")
    pytest.importorskip("PIL")
    run = motion(solver, [0, 0.1, np.nan])
    for show in (lambda: run.html(tmp_path / "a.html", solver), lambda: run.animate(tmp_path / "a.gif", solver)):
        with pytest.raises(ValueError, match=r"q\[2, 0\] \(rod\) is nan, expected finite numbers"):
            show()
    with pytest.raises(ValueError, match=r"q\[0\] \(rod\) is inf"):
        solver.picture([np.inf], path=tmp_path / "a.png")
    with pytest.raises(ValueError, match=r"q\[0\] \(rod\) is nan"):
        solver.view([np.nan])
    assert list(tmp_path.iterdir()) == []


def test_trajectories_of_no_times_are_refused_and_one_time_is_shown(solver, tmp_path):
    pytest.importorskip("viser")
    pytest.importorskip("PIL")
    for show in (
        lambda run: run.html(tmp_path / "a.html", solver),
        lambda run: run.animate(tmp_path / "a.gif", solver),
        lambda run: run.view(solver),
    ):
        with pytest.raises(ValueError, match="the trajectory of swing has no times, so there is nothing to show"):
            show(motion(solver, []))
    assert list(tmp_path.iterdir()) == []
    motion(solver, [0.1]).html(tmp_path / "one.html", solver)
    motion(solver, [0.1]).animate(tmp_path / "one.gif", solver)
    assert len(list(tmp_path.iterdir())) == 2


def test_a_million_results_make_a_page_of_some_thousand_with_one_warning(solver, tmp_path):
    pytest.importorskip("viser")
    run = motion(solver, np.linspace(0, 1, 1_000_000))
    with pytest.warns(RuntimeWarning) as caught:
        run.html(tmp_path / "long.html", solver)
    assert sorted(str(w.message) for w in caught) == [
        "10000 frames are too many for a page; 3000 of them are shown",
        "the motion has 1000000 results; 10000 of them are shown",
    ]
    assert (tmp_path / "long.html").stat().st_size < 3e6


@pytest.mark.parametrize("port", [-1, 65536, 99_999_999, "8080"])
def test_ports_that_do_not_exist_are_refused(solver, port):
    pytest.importorskip("viser")
    with pytest.raises(ValueError, match="1 to 65535 are allowed, and 0 for any that is free"):
        solver.view(port=port)


def test_a_port_that_is_used_is_not_replaced_by_another(solver):
    pytest.importorskip("viser")
    view = solver.view()
    try:
        with pytest.raises(ValueError, match=r"is not available .*; give another one, or none"):
            solver.view(port=int(view.url.rpartition(":")[2]))
    finally:
        view.close()


@pytest.mark.parametrize("length", ["1e-6", "1.0", "1e6"])
def test_pictures_of_any_size_look_the_same(tmp_path, length):
    """The rod fills the picture to the same extent, whatever its length."""
    pytest.importorskip("PIL")
    from PIL import Image

    solver = made(tmp_path, length, "[{type: box, size: [length/4, length/4, length], at: [0, 0, -length/2]}]")
    solver.picture(solver.initial[0], path=tmp_path / "a.png")
    dark = np.asarray(Image.open(tmp_path / "a.png").convert("L")) < 200
    rows, columns = (np.flatnonzero(dark.any(axis=k)) for k in (1, 0))
    assert 0.6 < (rows[-1] - rows[0]) / dark.shape[0] <= 1.0
    assert 0.03 < dark.mean() < 0.5 and len(columns)


@pytest.mark.parametrize("length", ["1e-6", "1.0", "1e6"])
def test_the_camera_sees_mechanisms_of_any_size(tmp_path, length):
    pytest.importorskip("viser")
    view = made(tmp_path, length, "[{type: sphere, radius: length/10, at: [0, 0, -length]}]").view()
    try:
        camera = view.server.initial_camera
        distance = np.linalg.norm(np.subtract(camera.position, camera.look_at))
        assert 10 * camera.near < distance < camera.far / 10
        assert 0.3 * distance < view.size < distance
    finally:
        view.close()


def test_without_anything_visible_the_joints_are_shown(tmp_path):
    pytest.importorskip("viser")
    pytest.importorskip("PIL")
    solver = made(tmp_path, visuals="[]")
    solver.picture(solver.initial[0], path=tmp_path / "a.png")
    view = solver.view()
    try:
        assert view.nodes.marks == ["joints"] and view.nodes.groups == []
    finally:
        view.close()


@pytest.mark.parametrize(
    ("absent", "call", "message"),
    [
        ("viser", "solver.view()", 'views need viser: pip install "ordernm[view]"'),
        ("viser", "run.html('a.html', solver)", 'views need viser: pip install "ordernm[view]"'),
        ("matplotlib", "solver.picture(q, path='a.png')", 'pip install "ordernm[plot]"'),
        ("matplotlib", "run.animate('a.gif', solver)", 'pip install "ordernm[plot]"'),
    ],
)
def test_a_missing_extra_is_named(tmp_path, absent, call, message):
    made(tmp_path)
    code = f"""
import sys
sys.modules[{absent!r}] = None
import numpy as np, ordernm
solver = ordernm.load("swing", target="numpy")
q = solver.initial[0]
run = ordernm.Trajectory("swing", [0.0], q[None], np.zeros((1, 1)), coordinate_names=solver.coordinate_names,
                         speed_names=solver.speed_names, parameter_names=solver.parameter_names)
try:
    {call}
except ImportError as error:
    print(error)
"""
    path = {"PYTHONPATH": str(Path(ordernm.__file__).parents[2])}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, env=environment(path)
    )
    assert message in done.stdout, done.stderr
    assert not (tmp_path / "a.png").exists() and not (tmp_path / "a.html").exists()


def environment(more):
    import os

    return {**os.environ, **{k: v + os.pathsep + os.environ.get(k, "") for k, v in more.items()}}


def test_without_trimesh_a_mesh_is_a_cube_and_one_warning_says_what_to_install(tmp_path, monkeypatch):
    pytest.importorskip("PIL")
    solver = made(tmp_path)
    (tmp_path / "none.stl").write_text("solid")
    monkeypatch.setitem(sys.modules, "trimesh", None)
    with pytest.warns(RuntimeWarning) as caught:
        solver.picture(solver.initial[0], path=tmp_path / "a.png", folder=tmp_path)
    assert [str(w.message) for w in caught] == [
        'mesh none.stl needs trimesh: pip install "ordernm[view]"; a cube of 0.05 m is shown instead'
    ]


def test_a_view_prints_nothing(solver, capsys):
    pytest.importorskip("viser")
    solver.view().close()
    assert capsys.readouterr() == ("", "")
