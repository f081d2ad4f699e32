"""docs/guide.md: every piece of its code runs, one after the other, and does what the page says."""

import re
import shutil
import subprocess
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

PAGE = (Path(__file__).parents[1] / "docs" / "guide.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> tuple[Path, list[dict[str, Any]]]:
    """The folder in which the page was followed, and what names meant after each piece of Python."""
    place = tmp_path_factory.mktemp("guide")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        for text in blocks("yaml"):
            Path(f"{re.findall('model: (.*)', text)[0]}.yaml").write_text(text)
        names: dict[str, Any] = {}
        after = []
        for code in blocks("python"):
            exec(compile(code, "guide.md", "exec"), names)
            after.append(dict(names))
    return place, after


def piece(run: tuple[Path, list[dict[str, Any]]], word: str) -> dict[str, Any]:
    """What names meant after the piece that contains a word."""
    (found,) = [names for code, names in zip(blocks("python"), run[1], strict=True) if word in code]
    return found


def test_the_pendulum(run):
    first = piece(run, "print(report)")
    assert first["height"] == pytest.approx(-np.cos(0.5)) and first["report"].compiled
    found = piece(run, 'dp={"length": 1.0}')
    assert found["dudot"].shape == (1, 1)
    # a uniform rod: udot = -3 g sin(q) / (2 l) nearly (the cylinder is thin)
    assert found["dudot"][0, 0] == pytest.approx(1.5 * 9.81 * np.sin(0.5), rel=1e-2)


def test_the_pendulum_is_lifted_and_identified(run):
    """The torque that lifts is at its bounds; lengths of simulated motions are those that made them."""
    lifted = piece(run, "lifted.outcome")
    assert lifted["lifted"].success and lifted["f"].motions < 200
    assert lifted["motion"]["height"][-1] == pytest.approx(-lifted["lifted"].fun, abs=1e-6)
    assert lifted["motion"]["energy"][-1] < 0.1 + 1e-5
    at_start = lifted["f"].simulate(lifted["f"].x0)
    assert lifted["motion"]["height"][-1] > at_start["height"].max()
    found = piece(run, "found.interval")
    assert found["low"] < 0.9 < found["high"] and abs(found["found"]["damping"] - 0.2) < 3 * found["found"].deviation(
        "damping"
    )
    many = piece(run, "ordernm.simulate_many")
    assert many["heights"].shape == (21, 61)
    assert many["heights"][:, 0] == pytest.approx(-np.cos(0.5) * many["lengths"])


def test_the_loop_is_closed(run):
    found = piece(run, "crank.closure")
    assert found["q"][0] == 1.2 and np.abs(found["gap"]).max() < 1e-12 and np.abs(found["rate"]).max() < 1e-10


def test_bodies_are_where_the_page_says(run):
    """The point of the coupler, by hand; its Jacobian times u; a derivative by the crank's length as `assemble` has it."""
    found = piece(run, "posed.point_jacobians")
    q, u, tip, every = (found[n] for n in ("q", "u", "tip", "every"))
    a, ab = q[0], q[0] + q[1]
    place = 0.4 * np.array([np.cos(a), 0, np.sin(a)]) + 0.6 * np.array([np.cos(ab), 0, np.sin(ab)])
    assert tip.position == pytest.approx(place + 0.1 * np.array([-np.sin(ab), 0, np.cos(ab)]), abs=1e-15)
    assert found["J"] @ u == pytest.approx([*every.angular_velocity[1], *tip.velocity], abs=1e-14)
    assert found["moved"].position.shape == (4, 3) and found["b"].acceleration.shape == (3,)


@pytest.mark.parametrize(("solver", "parameter"), [("pendulum", 0), ("pendulum", 1), ("crank", 0), ("crank", 3)])
def test_derivatives_of_motions(run, solver, parameter):
    """Against differences of motions, which are good for a few digits."""
    solver, times = run[1][-1][solver], np.array([0.0, 0.4])
    name = solver.parameter_names[parameter]
    p, step = solver.parameters, 1e-5 * np.eye(solver.np)[parameter]
    motion = solver.simulate(times, sensitivities=(name,), rtol=1e-11, atol=1e-11)
    a, b = (solver.simulate(times, p=p + s, rtol=1e-12, atol=1e-12) for s in (-step, step))
    np.testing.assert_allclose(motion.dq[0, -1], (b.q - a.q)[-1] / 2e-5, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(motion.du[0, -1], (b.u - a.u)[-1] / 2e-5, rtol=1e-4, atol=1e-4)


def test_a_loop_does_not_drift(run):
    crank = run[1][-1]["crank"]
    assert crank.simulate([0.0, 5.0, 10.0]).closure_drift < 1e-13


def test_motions_keep_their_energy(run):
    motion = run[1][-1]["crank"].simulate(np.linspace(0, 3, 7))
    assert motion.energy_drift < 1e-7 and motion.closure_drift < 1e-13


def test_assembly_is_many_times_an_evaluation(run):
    names = run[1][-1]
    crank = names["crank"]
    q, u = crank.initial
    open_q = q + [0.05, 0, 0]

    def least(function, *arguments):
        seconds = []
        for _ in range(40):
            start = time.perf_counter()
            function(*arguments)
            seconds.append(time.perf_counter() - start)
        return min(seconds)

    assert least(crank.assemble, open_q, u) > 10 * least(crank.accelerations, q, u)


def test_the_length_that_newton_finds(run):
    names = piece(run, "root_scalar")
    best = names["best"]
    assert best.converged and best.function_calls < 16
    assert abs(names["pendulum"].simulate([0.0, 0.6], p={"length": best.root}).q[-1, 0]) < 1e-8


def test_events_and_functionals(run):
    names = piece(run, "Event(")
    first = names["first"]
    assert first.outputs[0] == pytest.approx(-0.98, abs=1e-12) and np.isfinite(first.dt).all()
    judged = piece(run, "Integral(")["judged"]
    assert judged.values.shape == (2,) and np.isfinite(judged.gradients).all()


def test_trajectories(run):
    pytest.importorskip("matplotlib", reason="the page draws")
    place, names = run[0], piece(run, "swing.npz")
    motion, again = names["run"], names["again"]
    np.testing.assert_array_equal(again.derivative("height", "length"), motion.derivative("height", "length"))
    # height = -length cos(q)
    q, dq = motion["q.rod"], motion.derivative("q.rod", "length")
    np.testing.assert_allclose(
        motion.derivative("height", "length"), np.sin(q) * dq - np.cos(q), rtol=1e-12, atol=1e-12
    )
    assert 0 < motion.energy_drift < 1 and list(names["table"].columns[:4]) == ["q.rod", "u.rod", "height", "energy"]
    assert (place / "swing.svg").stat().st_size > 10_000 and len(names["figure"].axes) == 4


def test_the_controller(run):
    names = piece(run, "solve_continuous_are")
    A, B, gain = names["A"], names["B"], names["gain"]
    inertia = 0.5 * (0.4**2 + 0.8**2 / 12 + 0.01**2 / 4)  # of the cylinder about its foot
    grows = np.sqrt(0.5 * 9.81 * 0.4 / inertia)
    free = np.sort(np.linalg.eigvals(A).real)
    np.testing.assert_allclose(free, [-grows, -grows, 0, 0, grows, grows], atol=1e-7)  # two ways to fall, one to turn
    assert np.linalg.eigvals(A - B @ gain).real.max() < -0.1


def test_the_sweep(run):
    found = piece(run, "heights.csv")["found"]
    length, last, slope = found["length"], found["last"], found["by_length"]
    assert found.succeeded.all() and len(last) == 200 and np.all(last >= -length)
    means = (slope[1:] + slope[:-1]) / 2
    assert np.sum(means * np.diff(length)) == pytest.approx(last[-1] - last[0], abs=1e-3), "the derivatives' integral"
    assert len((run[0] / "heights.jsonl").read_text().splitlines()) == 201
    assert (run[0] / "heights.csv").read_text().startswith("length,last,by_length,failure\n0.5,")


def test_batches(run):
    names = piece(run, "batch_threads")
    assert names["udot"].shape == (10_000, 1)
    many = names["many"][18:]  # the piece after it spoils one before
    parts = [names["pendulum"].accelerations(part, names["u"]) for part in np.array_split(many, 4)]
    np.testing.assert_allclose(np.concatenate(parts), names["udot"][18:], rtol=1e-14)


def test_the_program_in_c(run):
    place, after = run
    compiler = shutil.which("cc") or pytest.skip("no C compiler")
    (program,), (command,) = blocks("c"), re.findall(r"^    cc (.*)$", PAGE, re.MULTILINE)
    (place / "swing.c").write_text(program)
    subprocess.run([compiler, "-Wall", "-Wextra", "-Werror", *command.split()], cwd=place, check=True)
    done = subprocess.run([place / "swing"], capture_output=True, text=True, check=True)
    pendulum = after[0]["pendulum"]
    expected = pendulum.accelerations(*pendulum.initial, inputs=[0.3])
    assert float(done.stdout) == pytest.approx(expected[0], rel=1e-13)
