"""Truncated or edited packages, compilers that hang or are missing, results that are not finite: messages."""

import json
import os
import re
import shutil
import signal
import stat
import subprocess
import sys
import time
import warnings

import numpy as np
import pytest

import codegen
from codegen.runtime import CompileError, PackageError, SimulationError
from codegen.runtime.standalone.calls.arguments import MOST_AXES

TEXT = """\
model: odd
parameters: {k: 2.0}
bodies:
  a: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, com: [0, 0, -0.5], inertia: {yy: 0.1}}
  b: {parent: a, joint: {type: revolute, axis: y, at: [0, 0, -1]}, mass: 1, com: [0, 0, -0.5], inertia: {yy: 0.1}}
forces:
  drive: {type: joint, joint: b, value: "k*(acos(1 + q.a) + sqrt(q.b))"}
outputs:
  speed: {value: u.a + u.b}
"""


@pytest.fixture(scope="module")
def odd(tmp_path_factory):
    return codegen.generate(codegen.parse_model(TEXT), tmp_path_factory.mktemp("packages") / "odd").folder


@pytest.fixture
def copied(odd, tmp_path):
    """A copy of a package that tests may damage."""
    folder = tmp_path / "odd"
    folder.mkdir()
    shutil.copytree(odd, folder, ignore=shutil.ignore_patterns("__pycache__"), dirs_exist_ok=True)
    return folder


def edited(**changes):
    def edit(text):
        return json.dumps({**json.loads(text), **changes})

    return edit


def without(key):
    def edit(text):
        return json.dumps({k: v for k, v in json.loads(text).items() if k != key})

    return edit


MANIFESTS = {
    "small workspace": edited(workspace=1), "no name": without("name"), "no seal": without("seal"),
    "one digit": lambda text: text.replace('"parameters": [2.0]', '"parameters": [3.0]'),
    "half": lambda text: text[: len(text) // 2], "deep": lambda text: "[" * 100_000, "empty": lambda text: "",
    "a byte more": lambda text: text + " ", "functions": edited(functions={}),
}  # fmt: skip


@pytest.mark.parametrize("target", ["c", "numpy"])
@pytest.mark.parametrize("damage", MANIFESTS)
def test_a_damaged_manifest_is_told(copied, damage, target):
    file = copied / "model.json"
    file.write_text(MANIFESTS[damage](file.read_text()))
    with pytest.raises(PackageError, match=r"model\.json is (damaged|not valid JSON).*generate MODEL\.yaml"):
        codegen.load(copied, target)


@pytest.mark.parametrize(
    "name",
    ["odd.c", "odd_calls.c", "odd.h", "odd_directions.h", "odd_numpy.py", "__init__.py", "_runtime/calls/package.py",
     "_runtime/calls/arguments.py"],
)  # fmt: skip
def test_a_damaged_file_is_named(copied, name):
    file = copied / name
    whole = file.read_bytes()
    target = "numpy" if name == "odd_numpy.py" else "c"
    for content in (whole[:-1], whole[: len(whole) // 2], b"", whole.replace(b"0", b"1", 1)):
        file.write_bytes(content)
        with pytest.raises(PackageError, match=rf"damaged: its {name} was changed.*generate it again"):
            codegen.load(copied, target)
    file.unlink()
    with pytest.raises(PackageError, match=rf"damaged: its {name} is missing"):
        codegen.load(copied, target)
    file.write_bytes(whole)
    assert codegen.load(copied, target).name == "odd"


@pytest.mark.parametrize("name", ["state/jacobians", "errors", "arrays", "files/compiler"])
def test_a_package_without_a_file_of_its_run_time_tells_by_itself(copied, name):
    (copied / "_runtime" / f"{name}.py").unlink()
    done = subprocess.run([sys.executable, "-c", "import odd"], cwd=copied.parent, capture_output=True, text=True)
    last = done.stderr.splitlines()[-1]
    assert re.fullmatch(
        rf"ImportError: .*odd is damaged: its _runtime/{name}\.py is missing since it was generated; generate it again: "
        r"generate MODEL\.yaml -o FOLDER", last
    ), done.stderr  # fmt: skip


def test_a_package_without_numpy_says_so(copied):
    program = "import sys; sys.modules['numpy'] = None; import odd"
    done = subprocess.run([sys.executable, "-c", program], cwd=copied.parent, capture_output=True, text=True)
    assert "import of numpy halted" in done.stderr.splitlines()[-1]


def test_a_damaged_package_tells_by_itself_too(copied):
    (copied / "odd.c").unlink()
    program = "from odd import Solver, PackageError\ntry: Solver()\nexcept PackageError as error: print(error)"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=copied.parent, capture_output=True, text=True, check=True
    )
    assert "its odd.c is missing" in done.stdout


# ---- compilers -------------------------------------------------------------------------------------------------------


def compiler(path, text):
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return str(path)


def ends(pid, seconds=5.0):
    """Whether a process ends."""
    stop = time.monotonic() + seconds
    while time.monotonic() < stop:
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.02)
    return False


HANG = 'case "$*" in *--version*) exit 0;; esac\necho $$ > "{pid}.part"\nmv "{pid}.part" "{pid}"\nsleep 60 & wait'


def test_a_compiler_that_hangs_is_stopped(pendulum, monkeypatch, tmp_path):
    pid = tmp_path / "pid"
    monkeypatch.setenv("CC", compiler(tmp_path / "cc", HANG.format(pid=pid)))
    monkeypatch.setenv("ORDERNM_COMPILE_SECONDS", "0.7")
    monkeypatch.setenv("ORDERNM_CFFI", "abi")
    with pytest.raises(CompileError, match=r"within 0\.7 s.*ORDERNM_COMPILE_SECONDS"):
        codegen.load(pendulum)
    assert ends(int(pid.read_text()))
    assert not list(pendulum.glob(".build*"))
    monkeypatch.setenv("ORDERNM_COMPILE_SECONDS", "soon")
    with pytest.raises(
        CompileError, match="ORDERNM_COMPILE_SECONDS=soon, expected a positive number; the default is 600"
    ):
        codegen.load(pendulum)


def test_a_compiler_that_does_not_even_tell_its_version_is_stopped(pendulum, monkeypatch, tmp_path):
    monkeypatch.setenv("CC", compiler(tmp_path / "silent", "exec sleep 60"))
    monkeypatch.setenv("ORDERNM_COMPILE_SECONDS", "0.3")
    with pytest.raises(CompileError, match=r"does not answer: .*silent --version"):
        codegen.load(pendulum)


def test_an_interrupted_build_leaves_no_compiler_behind(pendulum, tmp_path):
    pid = tmp_path / "pid"
    environment = {**os.environ, "CC": compiler(tmp_path / "cc", HANG.format(pid=pid)), "ORDERNM_CFFI": "abi"}
    program = "import sys, codegen; codegen.load(sys.argv[1])"
    process = subprocess.Popen(
        [sys.executable, "-c", program, str(pendulum)], env=environment, stderr=subprocess.PIPE, text=True
    )
    stop = time.monotonic() + 60
    while not pid.exists() and time.monotonic() < stop:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    assert "KeyboardInterrupt" in process.communicate(timeout=30)[1]
    assert ends(int(pid.read_text()))


def test_what_is_no_compiler_is_told(pendulum, monkeypatch):
    monkeypatch.setenv("CC", "/bin/cat")
    with pytest.raises(CompileError, match=r"/bin/cat fails even on a C file of one line; set CC"):
        codegen.load(pendulum)


# ---- results that are not finite -------------------------------------------------------------------------------------


@pytest.fixture(params=["c", "numpy"])
def solver(request, odd):
    return codegen.load(odd, request.param)


def told(call):
    """Results, and the warnings except those of NumPy."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = call()
    ours = [w for w in caught if "is not finite" in str(w.message)]
    assert all(w.category is RuntimeWarning and w.filename == __file__ for w in ours)
    return found, [str(w.message) for w in ours]


FORCE = r"force drive: on joint b: .*acos"


def test_a_force_without_value_is_named(solver):
    good, bad, u = np.array([-0.5, 0.5]), np.array([0.5, 0.5]), np.array([0.2, 0.3])
    for given in (bad, bad.tolist()):
        udot, (said,) = told(lambda given=given: solver.accelerations(given, u))
        assert np.isnan(udot).all()
        assert re.match(
            rf"odd: udot of accelerations is not finite: the force on joint b is not finite \({FORCE}", said
        )
    _, (said,) = told(lambda: solver.accelerations(np.array([[good, good], [good, bad]]), u))
    assert re.search(rf"in state \[1, 1\] of the batch.*{FORCE}", said)
    for q in (good, np.array([good, good])):
        _, said = told(
            lambda q=q: (solver.accelerations(q, u), solver.sensitivities(q, u, dq=np.ones(2)), solver.jacobians(q, u))
        )
        assert not said


def test_a_force_without_derivative_is_named(solver):
    q, u = np.array([-0.5, 0.0]), np.array([0.2, 0.3])
    for name, call in {
        "dudot of sensitivities": lambda: solver.sensitivities(q, u, dq=np.eye(2)),
        "J_q of jacobians": lambda: solver.jacobians(q, u),
    }.items():
        _, (said,) = told(call)
        assert said.startswith(
            f"odd: {name} is not finite: the derivative of the force on joint b with respect to q.b is not finite (force drive:"
        )


def test_a_motion_that_is_too_large_names_the_body(solver):
    q, u = np.array([-0.5, 0.5]), np.array([0.0, 1e160])
    for call in (lambda: solver.accelerations(q, u), lambda: solver.energies(q, u)):
        _, (said,) = told(call)
        assert said.endswith("the motion of body b is too large for floating-point numbers")
    _, (said,) = told(lambda: solver.outputs(q, np.array([1.7e308, 1.7e308])))
    assert "outputs of outputs is not finite" in said


SPRUNG = """\
model: sprung
parameters: {k: 2.0}
inputs: [pull]
bodies:
  a: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, com: [0, 0, -0.5], inertia: {yy: 0.1}}
  b: {parent: a, joint: {type: prismatic, axis: x, at: [0, 0, -1]}, mass: 1}
forces:
  coil: {type: spring, from: {body: b, at: [0, 0, -1]}, to: {body: ground, at: [0, 2, 0]}, stiffness: k*sqrt(pull)}
outputs:
  good: kinetic_energy
  first: {value: log(q.a)}
  second: {value: sqrt(q.b)}
"""


@pytest.fixture(scope="module")
def sprung(tmp_path_factory):
    return codegen.generate(codegen.parse_model(SPRUNG), tmp_path_factory.mktemp("packages") / "sprung").folder


@pytest.mark.parametrize("target", ["c", "numpy"])
def test_where_there_are_springs_the_reason_is_named_too(sprung, target):
    solver = codegen.load(sprung, target)
    q, u = np.array([0.3, 0.2]), np.array([0.0, 0.5])
    for call, what in {
        lambda: solver.accelerations(q, [1e170, 0.0]): "the motion of body a is too large for floats",
        lambda: solver.accelerations(q, u, [1e308], [2.0]): ") is not finite",
        lambda: solver.accelerations(q, u, inputs=[-1.0]): "the coefficients of spring coil are not finite",
        lambda: solver.sensitivities(q, u, dinputs=[1.0]): "coefficients of spring coil with respect to pull are not finite",
        lambda: solver.energy_sensitivities(q, u, dinputs=[1.0]): "of spring coil with respect to pull are not finite",
        lambda: solver.jacobians(q, u): "the derivatives of the coefficients of spring coil with respect to pull are not finite",
        lambda: solver.outputs(-q, u, inputs=[1.0]): "outputs of outputs is not finite: first, second",
        lambda: solver.output_sensitivities([0.3, -1.0], u, dq=q): "outputs of output_sensitivities is not finite: second",
    }.items():  # fmt: skip
        _, (said,) = told(call)
        assert said.endswith(what.replace("floats", "floating-point numbers")), said


@pytest.mark.parametrize("target", ["c", "numpy"])
def test_the_jacobians_of_a_batch_tell_the_state(sprung, target):
    solver = codegen.load(sprung, target)
    q, u = np.array([0.3, 0.2]), np.zeros((2, 1, 2))
    J, (said,) = told(lambda: solver.jacobians(q, u, inputs=[[[1.0]], [[0.0]]]))
    assert said.endswith(
        "in state [1, 0] of the batch: the derivatives of the coefficients of spring coil with respect to pull are not finite"
    )
    np.testing.assert_array_equal(J.q[0, 0], solver.jacobians(q, u[0, 0], inputs=[1.0]).q)
    J, (said,) = told(lambda: solver.jacobians(q, u + 1e170, inputs=[1.0]))
    assert said.endswith("in state [0, 0] of the batch: the motion of body a is too large for floating-point numbers")


@pytest.mark.parametrize("state", ["raise", "warn", "call"])
@pytest.mark.parametrize("target", ["c", "numpy"])
def test_what_numpy_does_about_overflow_does_not_matter(packages, target, state):
    # checks of arguments and the NumPy target square numbers: numbers that are allowed, and results that are told
    solver = codegen.load(packages / "satellite", target)
    q, u = solver.initial
    e = next(i for i, name in enumerate(solver.coordinate_names) if name.endswith(".qw"))

    def calls(size):
        large = q.copy()
        large[e : e + 4] *= size
        return (
            lambda: solver.assemble(large, u)[0],
            lambda: solver.solve_mass(q, (size * u).tolist()),
            lambda: solver.solve_mass(q, size * np.stack([u, u])),
            lambda: solver.sensitivities(q, u, dp={solver.parameter_names[0]: 1.0}, du=size * u)[1],
            lambda: solver.mass_matrix_sensitivities(q, dq=size * q)[1],
        )

    for size in (1e170, 1e-170):
        for i, call in enumerate(calls(size)):
            if i == 0 and size < 1:
                continue  # such a quaternion is refused
            expected = calls(1.0)[i]()
            with np.errstate(all=state, call=pytest.fail), warnings.catch_warnings():
                warnings.simplefilter("error")
                found = call()
            if i != 3:
                np.testing.assert_allclose(found, expected * (1.0 if i == 0 else size), rtol=1e-12, atol=1e-14 * size)
    with np.errstate(all=state, call=pytest.fail), pytest.warns(RuntimeWarning, match="motion of body"):
        assert not np.isfinite(solver.accelerations(q, np.full(solver.nu, 1e170))).all()


# ---- batches ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("axes", [31, 40, 62])
def test_more_batch_axes_than_numpy_can_take_are_told(solver, axes):
    q, u = np.full((1,) * axes + (2,), -0.5), np.zeros(2)
    for call in (
        lambda: solver.accelerations(q, u), lambda: solver.sensitivities(u, u, dq=q), lambda: solver.assemble(q, u),
        lambda: solver.accelerations(u, u, t=q[..., 0]),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=r"has \d\d axes, expected at most 29 for the states of a batch; reshape"):
            call()


def test_as_many_batch_axes_as_allowed_work(solver):
    q, u = np.full((1,) * MOST_AXES + (2,), -0.5), np.full(2, 0.5)
    q[..., 1] = 0.5
    assert solver.jacobians(q, u).q.shape == (*(1,) * MOST_AXES, 2, 2)
    assert solver.sensitivities(q, u, dq=q)[1].shape == (*(1,) * (MOST_AXES + 1), 2)


def test_results_larger_than_memory_are_told_with_their_size(odd):
    solver = codegen.load(odd)
    q, u = np.broadcast_to([-0.5, 0.5], (10**6, 10**6, 2)), np.zeros(2)
    for call, shape in (
        (lambda: solver.accelerations(q, u), r"\(1000000, 1000000, 2\)"),
        (lambda: solver.sensitivities(q, u, dq=np.ones((8, 1, 1, 2))), r"\(.*1000000, 1000000, 2\)"),
        (lambda: solver.jacobians(q, u), r"\(1000000, 1000000, 2(, 2)?\)"),
    ):
        with pytest.raises(MemoryError, match=rf"results of shape {shape} take \d[\d,]* GiB.*fewer states"):
            call()


@pytest.mark.parametrize("target", ["c", "numpy"])
def test_prescribed_motion_without_value_is_named_and_no_spring(tmp_path, target):
    model = codegen.parse_model("""
model: carried
bodies:
  a: {parent: ground, mass: 1, joint: {type: prismatic, axis: x}}
  b: {parent: a, mass: 1, joint: {type: prismatic, axis: y}}
points: {tip: {body: b}, post: {body: ground, at: [0, 0, 3]}}
forces:
  cord: {type: spring, from: tip, to: post, stiffness: 2, free_length: 1}
motion: {a: asin(t)}
""")
    codegen.generate(model, tmp_path)
    solver = codegen.load(tmp_path, target=target)
    because = "the prescribed position of a is not finite (motion a = asin(t))"
    udot, (said,) = told(lambda: solver.accelerations([0.0], [0.0], t=2.0))
    assert np.isnan(udot).all()
    assert said == f"carried: udot of accelerations is not finite: {because}"
    udot, (said,) = told(lambda: solver.accelerations([[0.0], [0.0]], [0.0], t=[0.5, 2.0]))
    assert np.isfinite(udot[0]).all() and np.isnan(udot[1]).all()
    assert said == f"carried: udot of accelerations is not finite in state [1] of the batch: {because}"
    with pytest.raises(SimulationError, match=re.escape(because)):
        solver.simulate(2.0)
