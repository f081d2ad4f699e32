"""Pages of the documentation: their code runs and prints what they show; tutorials and how-to pages reach their aims."""

import re
import time

import numpy as np
import pytest
from doc_pages import BLOCK, DOCS, ROOT, Followed, blocks, follow, text_of

ELSEWHERE = {
    "docs/import.md": "tests/importing/test_page.py",
    "docs/equations.md": "tests/symbolic/test_equations_page.py",
    "docs/views.md": "tests/display/test_page.py",
    "docs/model_format.md": "tests/model/test_documentation.py",
    "docs/howto/jax.md": "tests/learning/test_pages.py",
    "docs/howto/torch.md": "tests/learning/test_pages.py",
    "docs/live/index.md": "tests/live/test_live.py",
    "docs/api.md": "tests/documentation/test_pages.py",  # one block, below
    "docs/development.md": "",  # commands of developers, as in CONTRIBUTING.md
    "docs/howto/casadi.md": "tests/with_casadi/test_casadi_page.py",
    "docs/index.md": "",  # commands of README.md
}
"""Pages whose blocks other tests run."""

PAGES = sorted(
    name
    for page in DOCS.rglob("*.md")
    if "node_modules" not in page.parts
    and (name := page.relative_to(ROOT).as_posix()) not in ELSEWHERE
    and not name.startswith("docs/gallery/")
    and BLOCK.search(page.read_text(encoding="utf-8"))
)


@pytest.fixture(scope="module")
def followed(tmp_path_factory):
    """Run a page once; returns the values of its names."""
    known: dict[str, Followed] = {}

    def get(name: str) -> Followed:
        if name not in known:
            known[name] = follow(name, tmp_path_factory.mktemp("page"))
        return known[name]

    return get


@pytest.mark.parametrize("page", PAGES)
def test_all_blocks_of_a_page_run(page, followed):
    followed(page)


def test_every_page_with_code_is_known():
    assert {"docs/tutorial.md", "docs/trust.md", "docs/howto/loops.md", "docs/howto/c.md"} <= set(PAGES) and len(
        PAGES
    ) >= 13
    assert all((ROOT / test).exists() for test in ELSEWHERE.values() if test)


def test_the_page_of_a_solver_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (code,) = [code for language, code in BLOCK.findall(text_of("docs/api.md")) if language == "python"]
    (tmp_path / "model.yaml").write_text((ROOT / "examples" / "pendulum.yaml").read_text())
    exec(compile(code, "docs/api.md", "exec"), {})


def test_the_tutorial(followed):
    tutorial = followed("docs/tutorial.md")
    q, u = tutorial.names["pendulum"].initial
    _, dudot = tutorial.names["pendulum"].sensitivities(q, u, dp={"length": 1.0})
    # a uniform rod: udot = -3 g sin(q) / (2 l) nearly (the cylinder is thin)
    assert dudot[0, 0] == pytest.approx(1.5 * 9.81 * np.sin(0.5), rel=1e-2)
    best = tutorial.piece("ordernm.optimize(f)")["best"]
    assert best.success and np.ptp(tutorial.names["after"]["z"]) < 6e-4 < np.ptp(tutorial.names["before"]["z"]) / 50
    first = tutorial.piece("Event(")["first"]
    assert first.q[0] == pytest.approx(0, abs=1e-12)
    torque = tutorial.piece("inverse_dynamics_sensitivities")["torque"]  # of gravity: masses times lever arms
    fore = 9.81 * 0.2 * np.sin(1.4)
    assert -torque == pytest.approx([fore + 9.81 * np.sin(0.8) * (2 * 0.25 + 0.5), fore], rel=1e-12)


def test_the_choice_of_dependents_is_that_of_the_reference():
    """What docs/api.md prints about a loop is what `generate` prints of the tutorial's four-bar, apart from names."""
    quoted = re.findall(r"^    (1 loop: .*\n(?:    .*\n)+)", text_of("docs/api.md"), re.MULTILINE)[0]
    (shown,) = [text for text in blocks("docs/tutorial.md", "console") if "1 loop" in text]
    lines = [line.strip() for line in quoted.replace("coupler, rocker", "b, c").replace("crank", "a").splitlines()]
    assert [line for line in lines if line not in [s.strip() for s in shown.splitlines()]] == []


def test_the_motor_is_saturated_and_the_crane_follows(followed):
    drive = followed("docs/howto/drive.md")
    arm = drive.piece("positioner.yaml")["run"]
    assert np.abs(arm["torque"]).max() == pytest.approx(0.8, abs=0.01) and abs(arm["angle"][-1] + 1) < 0.1
    crane, way = drive.names["run"], drive.names["way"]
    # the driving force accelerates trolley and load: its integral is the momentum that both have gained
    both = 200 * way(crane.t, 1) + 800 * (way(crane.t, 1) - 5 * np.cos(crane["swing"]) * crane["u.load"])
    gained = np.concatenate([[0], np.cumsum((crane["force"][1:] + crane["force"][:-1]) / 2 * np.diff(crane.t))])
    np.testing.assert_allclose(gained, both - both[0], atol=2e-3 * np.abs(both).max())


def test_the_cam_lifts(followed):
    cams = followed("docs/howto/periodic_tables.md")
    assert cams.piece("turned_cam.yaml")["run"]["height"].min() == pytest.approx(0.020, abs=1e-4)
    cam = cams.piece("for rpm in")["cam"]
    speed, h = cam.parameters[0], 1e-5
    x = [cam.simulate([0.0, t])["opening"][-1] for t in (0.015 - h, 0.015, 0.015 + h)]
    force = 0.1 * (x[2] - 2 * x[1] + x[0]) / h**2 + 200 + 25e3 * x[1] - 0.1 * 9.81  # gravity opens the valve
    assert cam.simulate([0.0, 0.015])["contact"][-1] == pytest.approx(force, rel=1e-4) and speed > 100


def test_friction_and_length_are_identified(followed):
    fit = followed("docs/howto/fit.md")
    pendulum, sledge = (fit.piece(word)["found"] for word in ("found.interval", "sledge.yaml"))
    assert abs(pendulum["damping"] - 0.2) < 3 * pendulum.deviation("damping")
    assert fit.piece("found.interval")["low"] < 0.9 < fit.piece("found.interval")["high"]
    assert abs(sledge["mu"] - 0.15) < 3 * sledge.deviation("mu") and abs(sledge["drag"] - 0.8) < 3 * sledge.deviation(
        "drag"
    )


def test_the_pendulum_is_lifted(followed):
    """The torque that lifts is at its bounds."""
    lifted = followed("docs/howto/optimise.md").piece("lifted.outcome")
    assert lifted["lifted"].success and lifted["f"].motions < 200
    assert lifted["motion"]["height"][-1] == pytest.approx(-lifted["lifted"].fun, abs=1e-6)
    assert lifted["motion"]["energy"][-1] < 0.1 + 1e-5
    at_start = lifted["f"].simulate(lifted["f"].x0)
    assert lifted["motion"]["height"][-1] > at_start["height"].max()


def test_the_length_that_newton_finds(followed):
    names = followed("docs/howto/optimise.md").piece("root_scalar")
    best = names["best"]
    assert best.converged and best.function_calls < 16
    assert abs(names["pendulum"].simulate([0.0, 0.6], p={"length": best.root}).q[-1, 0]) < 1e-8
    judged = followed("docs/howto/optimise.md").piece("pendulum.judge(")["judged"]
    assert judged.values.shape == (2,) and np.isfinite(judged.gradients).all()


def test_the_loop_is_closed(followed):
    found = followed("docs/howto/loops.md").piece("crank.closure")
    assert found["q"][0] == 1.2 and np.abs(found["gap"]).max() < 1e-12 and np.abs(found["rate"]).max() < 1e-10


def test_bodies_are_where_the_page_says(followed):
    """The point of the coupler, by hand; its Jacobian times u; a derivative by the crank's length as `assemble` has it."""
    found = followed("docs/howto/frames.md").piece("posed.point_jacobians")
    q, u, tip, every = (found[n] for n in ("q", "u", "tip", "every"))
    a, ab = q[0], q[0] + q[1]
    place = 0.4 * np.array([np.cos(a), 0, np.sin(a)]) + 0.6 * np.array([np.cos(ab), 0, np.sin(ab)])
    assert tip.position == pytest.approx(place + 0.1 * np.array([-np.sin(ab), 0, np.cos(ab)]), abs=1e-15)
    assert found["J"] @ u == pytest.approx([*every.angular_velocity[1], *tip.velocity], abs=1e-14)
    assert found["moved"].position.shape == (4, 3) and found["b"].acceleration.shape == (3,)


@pytest.mark.parametrize(("solver", "parameter"), [("pendulum", 0), ("pendulum", 1), ("crank", 0), ("crank", 3)])
def test_derivatives_of_motions(followed, solver, parameter):
    """Against differences of motions, which are good for a few digits."""
    solver, times = followed("docs/howto/simulate.md").names[solver], np.array([0.0, 0.4])
    name = solver.parameter_names[parameter]
    p, step = solver.parameters, 1e-5 * np.eye(solver.np)[parameter]
    motion = solver.simulate(times, sensitivities=(name,), rtol=1e-11, atol=1e-11)
    a, b = (solver.simulate(times, p=p + s, rtol=1e-12, atol=1e-12) for s in (-step, step))
    np.testing.assert_allclose(motion.dq[0, -1], (b.q - a.q)[-1] / 2e-5, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(motion.du[0, -1], (b.u - a.u)[-1] / 2e-5, rtol=1e-4, atol=1e-4)


def test_motions_keep_energy_and_loops(followed):
    crank = followed("docs/howto/simulate.md").names["crank"]
    assert crank.simulate([0.0, 5.0, 10.0]).closure_drift < 1e-13
    motion = crank.simulate(np.linspace(0, 3, 7))
    assert motion.energy_drift < 1e-7 and motion.closure_drift < 1e-13


def test_assembly_is_many_times_an_evaluation(followed):
    crank = followed("docs/howto/simulate.md").names["crank"]
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


def test_events(followed):
    first = followed("docs/howto/simulate.md").piece("first.t, first.dt")["first"]
    assert first.outputs[0] == pytest.approx(-0.98, abs=1e-12) and np.isfinite(first.dt).all()


def test_the_derivative_of_the_largest_acceleration(followed):
    """Against differences of the largest values of longer and shorter pendulums, whose peaks are at other times."""
    found = followed("docs/howto/simulate.md").piece("minimize_scalar")
    solver, at = found["lifting"], found["peak"].x

    def largest(length):
        t = np.linspace(at - 0.002, at + 0.002, 41)
        lift = solver.simulate(np.r_[0.0, t], p={"length": length}, rtol=1e-12, atol=1e-12)["lift"][1:]
        a, b, c = np.polyfit(t - at, lift, 2)
        return c - b**2 / (4 * a), at - b / (2 * a)

    (low, early), (high, late) = largest(0.9999), largest(1.0001)
    assert found["run"].derivative("lift", "length")[-1] == pytest.approx((high - low) / 0.0002, rel=1e-4)
    assert late - early > 1e-5


def test_trajectories(followed):
    pytest.importorskip("matplotlib", reason="the page draws")
    page = followed("docs/howto/simulate.md")
    names = page.piece("swing.npz")
    motion, again = names["run"], names["again"]
    np.testing.assert_array_equal(again.derivative("height", "length"), motion.derivative("height", "length"))
    # height = -length cos(q)
    q, dq = motion["q.rod"], motion.derivative("q.rod", "length")
    np.testing.assert_allclose(
        motion.derivative("height", "length"), np.sin(q) * dq - np.cos(q), rtol=1e-12, atol=1e-12
    )
    assert 0 < motion.energy_drift < 1 and list(names["table"].columns[:4]) == ["q.rod", "u.rod", "height", "energy"]
    assert (page.place / "swing.svg").stat().st_size > 10_000 and len(names["figure"].axes) == 4


def test_the_controller(followed):
    names = followed("docs/howto/equilibrium.md").piece("solve_continuous_are")
    A, B, gain = names["A"], names["B"], names["gain"]
    inertia = 0.5 * (0.4**2 + 0.8**2 / 12 + 0.01**2 / 4)  # of the cylinder about its foot
    grows = np.sqrt(0.5 * 9.81 * 0.4 / inertia)
    free = np.sort(np.linalg.eigvals(A).real)
    np.testing.assert_allclose(free, [-grows, -grows, 0, 0, grows, grows], atol=1e-7)  # two ways to fall, one to turn
    assert np.linalg.eigvals(A - B @ gain).real.max() < -0.1


def test_the_sweep(followed):
    page = followed("docs/howto/sweep.md")
    found = page.piece("heights.csv")["found"]
    length, last, slope = found["length"], found["last"], found["by_length"]
    assert found.succeeded.all() and len(last) == 200 and np.all(last >= -length)
    means = (slope[1:] + slope[:-1]) / 2
    assert np.sum(means * np.diff(length)) == pytest.approx(last[-1] - last[0], abs=1e-3), "the derivatives' integral"
    assert len((page.place / "heights.jsonl").read_text().splitlines()) == 201
    assert (page.place / "heights.csv").read_text().startswith("length,last,by_length,failure\n0.5,")
    heights = page.piece("simulate_many")
    assert heights["heights"][:, 0] == pytest.approx(-np.cos(0.5) * heights["lengths"])


def test_batches(followed):
    names = followed("docs/howto/sweep.md").piece("batch_threads")
    assert names["udot"].shape == (10_000, 1)
    many = names["many"][18:]  # the piece after it spoils one before
    parts = [names["pendulum"].accelerations(part, names["u"]) for part in np.array_split(many, 4)]
    np.testing.assert_allclose(np.concatenate(parts), names["udot"][18:], rtol=1e-14)


def test_the_program_in_c(followed):
    page = followed("docs/howto/c.md")
    import subprocess

    import codegen

    done = subprocess.run([page.place / "swing"], capture_output=True, text=True, check=True)
    pendulum = codegen.load(page.place / "generated" / "pendulum")
    expected = pendulum.accelerations(*pendulum.initial, inputs=[0.3])
    assert float(done.stdout) == pytest.approx(expected[0], rel=1e-13)
