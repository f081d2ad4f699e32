"""The numbers of a report are the solver's own: report.json is computed once more, from the model and the states in it."""

import json
import os
from pathlib import Path

import mpmath
import numpy as np
import pytest

import codegen
from codegen.measure.core import Core, Turn, record
from codegen.reference import RecursiveEngine
from codegen.reporting import Request, figures, integrating, motions, processes, report
from codegen.reporting.errors import DIGITS
from codegen.reporting.states import State

pytest.importorskip("matplotlib", reason="reports draw figures; the extra plot installs matplotlib")

MODEL = Path(__file__).parents[2] / "examples" / "slider_crank.yaml"
END = 0.4


@pytest.fixture(scope="module")
def numbers(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report") / "report"
    report(MODEL, folder, request=Request(end=END, timing=0.005, reference=300.0))
    return json.loads((folder / "report.json").read_text())


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return codegen.generate(MODEL, tmp_path_factory.mktemp("solver") / "package", check=False)


@pytest.fixture(scope="module")
def solver(made):
    """Compiled as the report's was."""
    return codegen.load(made.folder)


def at(state):
    return np.array(state["q"]), np.array(state["u"]), None, np.array(state["inputs"]), state["t"]


def largest(x):
    return max(abs(e) for e in np.ravel(x))


def error(x, exact):
    difference = [mpmath.mpf(float(a)) - e for a, e in zip(np.ravel(x), np.ravel(exact), strict=True)]
    return float(largest(difference) / largest(exact))


def test_what_was_generated(numbers, made, solver):
    model, found = codegen.load_model(MODEL), numbers["generated"]
    assert found["operations"] == solver.operations
    assert found["freedoms"] == len(solver.independent_speed_names)
    counts = (
        len(model.bodies),
        len(model.loops),
        solver.nq,
        solver.nu,
        solver.np,
        solver.ninputs,
        len(solver.output_names),
    )
    names = ("bodies", "loops", "coordinates", "speeds", "parameters", "inputs", "outputs")
    assert tuple(found[n] for n in names) == counts
    assert (found["kinds"], found["layout"], found["links"]) == (made.kinds, made.layout, made.links)
    sources = [p for p in Path(made.folder).rglob("*") if p.suffix in (".c", ".h") and p.parent.name != "motion"]
    assert found["code_bytes"] == sum(p.stat().st_size for p in sources)
    assert found["code_lines"] == sum(len(p.read_text().splitlines()) for p in sources)
    assert found["seconds"]["read"] > 1e-4  # a model file is not read in no time


def test_states_are_closed_and_have_the_condition_that_is_said(numbers, solver):
    assert len(numbers["states"]) >= 5
    for state in numbers["states"]:
        q, u, _, inputs, t = at(state)
        assert np.abs(np.concatenate([np.ravel(g) for g in solver.closure(q, u)])).max() < 1e-6
        condition = max(c.condition for c in solver.diagnose(q, u, None, inputs, t).closures)
        assert state["condition"] == pytest.approx(condition, rel=1e-9)


def test_errors_and_estimates(numbers, solver):
    """In all digits: the compiled code is the same, and so is what it is compared with."""
    model = codegen.load_model(MODEL)
    engine = RecursiveEngine(model, numbers="mpmath")
    record, state = numbers["errors"][1], numbers["states"][1]
    assert record["state"] == state["name"]
    seeds = np.eye(solver.np)
    udot, dudot = solver.sensitivities(*at(state), dp=seeds)
    trusted = solver.diagnose(*at(state), dp=seeds)
    with mpmath.workdps(DIGITS):
        exact, dexact = engine.sensitivities(*at(state), dp=seeds)
        assert record["udot"] == pytest.approx(error(udot, exact), rel=1e-9)
        assert record["estimate"] == pytest.approx(trusted.udot_error.max() / float(largest(exact)), rel=1e-9)
        for i, name in enumerate(model.parameter_names):
            natural = float(largest(exact)) / abs(solver.parameters[i])
            vanishes = largest(dexact[i]) <= 1e-12 * natural
            assert (name in record["vanish"]) == vanishes
            size = natural if vanishes else float(largest(dexact[i]))
            difference = float(largest([mpmath.mpf(float(a)) - e for a, e in zip(dudot[i], dexact[i], strict=True)]))
            assert record["derivatives"][name] == pytest.approx(difference / size, rel=1e-9)
            assert record["estimates"][name] == pytest.approx(trusted.dudot_error[i].max() / size, rel=1e-9)


def test_jacobians_and_gradient_of_the_first_state(numbers, solver):
    engine = RecursiveEngine(codegen.load_model(MODEL), numbers="mpmath")
    state = at(numbers["states"][0])
    found = solver.jacobians(*state)
    weights = np.random.default_rng(3).normal(size=solver.nu)
    gradients = solver.gradients(*state, weights=weights)
    columns, parts = [], []
    with mpmath.workdps(DIGITS):
        exact = engine.jacobians(*state)
        for part in ("q", "u", "p", "t"):
            a, b = (np.asarray(getattr(x, part)).reshape(solver.nu, -1) for x in (found, exact))
            columns += [error(x, y) for x, y in zip(a.T, b.T, strict=True) if largest(y) > 1e-9]
            if largest(b) > 0:
                whole = [sum(mpmath.mpf(float(w)) * x for w, x in zip(weights, column, strict=True)) for column in b.T]
                parts.append(error(getattr(gradients, part), whole))
    assert numbers["errors"][0]["jacobians"] == pytest.approx(max(columns), rel=1e-9)
    assert numbers["errors"][0]["gradient"] == pytest.approx(max(parts), rel=1e-9)


def test_finite_differences(numbers, solver):
    found, state = numbers["differences"], at(numbers["states"][0])
    i = solver.parameter_names.index(found["by"])
    q, u, _, inputs, t = state
    derivative = solver.sensitivities(*state, dp=np.eye(solver.np)[i : i + 1])[1][0]

    def udot(h):
        p = solver.parameters + h * np.eye(solver.np)[i]
        return solver.accelerations(solver.assemble(q, u, p)[0], u, p, inputs, t)

    for n in (14, 20, 28):
        h = found["steps"][n]
        for kind, quotient in (("forward", (udot(h) - udot(0)) / h), ("central", (udot(h) - udot(-h)) / (2 * h))):
            assert found[kind][n] == pytest.approx(largest(quotient - derivative) / largest(derivative), rel=1e-3)
    assert found["exact"] == numbers["errors"][0]["derivatives"][found["by"]]


def test_motions(numbers, solver):
    found = numbers["motions"]
    names = found["sensitivities"]
    assert found["end"] == END and found["choices"] == 1

    def moved(method, tolerance):
        return solver.simulate([0.0, END], sensitivities=names, method=method, rtol=tolerance, atol=tolerance,
                               atol_sensitivities=tolerance)  # fmt: skip

    best = moved("dop853", 1e-13)
    for method in ("dop853", "radau"):
        for i in (0, 2):
            point = found["methods"][method][i]
            x = moved(method, point["setting"])
            assert point["evaluations"] == x.stats["evaluations"]
            parts = [largest(a[-1] - b[-1]) / largest(b[-1]) for a, b in ((x.q, best.q), (x.u, best.u))]
            assert point["error"] == pytest.approx(max(parts), rel=1e-6, abs=1e-14)
            pairs = [(a[k, -1], b[k, -1]) for a, b in ((x.dq, best.dq), (x.du, best.du)) for k in range(len(names))]
            along = [largest(a - b) / largest(b) for a, b in pairs if largest(b)]
            assert point["sensitivity_error"] == pytest.approx(max(along), rel=1e-6, abs=1e-13)
            assert 0 < point["seconds"] <= point["seconds_high"]


def test_times_are_of_several_processes(numbers, solver, tmp_path):
    """A motion that takes long is timed twice, a short one by every process; functions by all of them."""
    setting = integrating.Setting(END, ["L"], "dop853", 1e-6)
    core = Core.compiled(tmp_path)
    here = [(setting, Turn(1e-9, 7.0, 7.0)), (setting, Turn(9.0, 8.0, 8.0))]
    times, motions_, peaks = processes.timed(
        core,
        solver.folder,
        State("random 1", *solver.initial, np.zeros(solver.ninputs), 0.0),
        0.01,
        solver.folder,
        here,
    )
    assert set(times["functions"]) == set(numbers["times"]["functions"])
    udot = times["functions"]["udot"]["compiled"]
    assert 0 < udot["least"] <= udot["median"] <= udot["high"] and udot["turns"] >= processes.PROCESSES
    short, long_ = motions_
    assert short["least"] == 1e-9 < short["high"] < 1.0  # the one that this process has seen, and others
    assert short["core"] < 1.0  # the median
    assert long_["high"] == 9.0 and long_["least"] < 1.0
    assert short["turns"] > processes.PROCESSES and long_["turns"] > 1
    assert all(x["turns"] >= processes.PROCESSES for x in peaks.values())
    alone, none, peaks = processes.timed(core, solver.folder, None, 0.01, solver.folder, here[:1])
    assert alone == {} == peaks and len(none) == 1


def test_the_core_is_timed_beside_everything(numbers):
    """Its work never changes: all moments of a report are within what others on the machine make of it."""
    times, roofline = numbers["times"], numbers["roofline"]
    records = [x[kind] for x in times["functions"].values() for kind in ("compiled", "call")]
    records += times["batches"].values()
    points = [p for points in numbers["motions"]["methods"].values() for p in points]
    for work, low, high in (("core", 1e-6, 1e-2), ("cache", 1e-12, 1e-8)):  # seconds, and seconds a byte
        assert 0 < times[work]["least"] <= times[work]["median"] <= times[work]["high"]
        assert all(low < x[work] < high for x in (*records, *points))
        assert all(low < x < high for x in roofline[work].values())
        assert all(x[work] >= times[work]["least"] for x in records)


def test_a_record_is_of_all_turns():
    found = record([Turn(3.0, 0.1, 5.0), Turn(1.0, 0.3, 4.0), Turn(2.0, 0.2, 6.0)])
    assert found == {"least": 1.0, "median": 2.0, "high": 3.0, "turns": 3, "core": 0.2, "cache": 5.0}


def test_after_a_long_turn_the_core_is_watched_for_longer(tmp_path, monkeypatch):
    core, counted = Core.compiled(tmp_path), []
    monkeypatch.setattr(core, "seconds", lambda: counted.append(1) or len(counted))
    assert core.turn(lambda: 1e-6).core == 1.5
    counted.clear()
    assert core.turn(lambda: 0.02).core == 6.0
    counted.clear()
    core.turn(lambda: 100.0)
    assert len(counted) == 31


def test_a_turn_stays_on_a_core_and_all_are_free_afterwards(tmp_path):
    if not hasattr(os, "sched_setaffinity"):
        pytest.skip("this system does not say on which cores a process is")
    core, allowed = Core.compiled(tmp_path), os.sched_getaffinity(0)
    with core.fastest():
        assert len(os.sched_getaffinity(0)) == 1
        assert core.turn(lambda: 5.0).seconds == 5.0
    assert os.sched_getaffinity(0) == allowed


def test_what_a_process_says_is_told(tmp_path):
    with pytest.raises(RuntimeError, match="holds no generated solver that is whole"):
        processes.timed(Core.compiled(tmp_path), tmp_path, None, 0.01, tmp_path, [])


def test_where_the_last_digits_are_not_to_be_had_the_reference_is_looser(solver, tmp_path, monkeypatch):
    """No diagram against a motion that never came to its end."""
    counts = {t: solver.simulate(END, method="dop853", rtol=t, atol=t).stats for t in (1e-13, 1e-12)}
    steps = {t: c["steps"] + c["rejected"] for t, c in counts.items()}
    assert steps[1e-12] < steps[1e-13]
    monkeypatch.setattr(integrating, "_most_steps", lambda *_: steps[1e-12])
    monkeypatch.setattr(motions, "MOST_SENSITIVITIES", 0)
    found = motions.motions(
        codegen.load_model(MODEL), solver, END, [], lambda partitions: solver, Core.compiled(tmp_path)
    )
    assert found["reference"] == "dop853 at 1e-12" and 0 < found["reference_error"] < 1e-9
    assert min(p["setting"] for p in found["methods"]["dop853"]) == pytest.approx(1e-11)
    monkeypatch.setattr(integrating, "_most_steps", lambda *_: 1)
    left_out = []
    assert (
        motions.motions(
            codegen.load_model(MODEL), solver, END, left_out, lambda partitions: solver, Core.compiled(tmp_path)
        )
        is None
    )
    assert [s.what for s in left_out] == ["motions"] and "steps" in left_out[0].why


def test_a_motion_of_which_nothing_is_known_is_halved_and_its_empty_diagram_drawn(solver, tmp_path, monkeypatch):
    """As chaotic ones are; what the error of the reference is stands for that here."""
    judged = motions._errors
    chaotic = 0.6 * END
    monkeypatch.setattr(motions, "_errors", lambda x, y, v: (1.5, 2e4) if y.t[-1] > chaotic else judged(x, y, v))
    monkeypatch.setattr(motions, "MOST_SENSITIVITIES", 1)
    found = motions.motions(
        codegen.load_model(MODEL), solver, END, [], lambda partitions: solver, Core.compiled(tmp_path)
    )
    assert found["end"] == END / 2 and found["asked"] == END and "differ by 2e+04" in found["ended"]
    assert found["reference_error"] < 1e-9
    drawn = figures.work_precision(found)
    empty = figures.work_precision(found | {"methods": {name: [] for name in found["methods"]}})
    assert drawn.startswith("<svg") and empty.startswith("<svg")
    assert empty.count("<use") < drawn.count("<use")  # markers, of which there are none but on axes and in the legend


def test_conditions_along_the_motion(numbers, solver):
    found = numbers["motions"]["conditions"]
    x = solver.simulate(np.array(found["t"]), rtol=1e-9, atol=1e-9)
    for n in (0, 77, 100):
        here = solver.diagnose(x.q[n], x.u[n], t=x.t[n])
        assert found["closures"][n] == pytest.approx(max(c.condition for c in here.closures), rel=1e-6)
        assert found["mass_matrix"][n] == pytest.approx(here.mass.condition, rel=1e-6)


def test_the_roofline_counts_what_a_call_takes(numbers, solver):
    for point, function, k in zip(
        numbers["roofline"]["points"], ("accelerations", *2 * ("sensitivities",)), (0, 1, 8), strict=True
    ):
        sweeps = solver.operations[function].values()
        count = sum(sum(s["per_call"].values()) + k * sum(s["per_direction"].values()) for s in sweeps)
        assert point["operations"] == count
        assert point["per_second"] == pytest.approx(
            count / numbers["times"]["functions"][point["name"]]["compiled"]["least"]
        )


BLOWING_UP = """\
model: blow
parameters: {gain: 1.0}
bodies: {cart: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1.0}}
forces: {push: {type: joint, joint: cart, value: gain*(1 + u.cart**2)}}
initial: {u: {cart: 1.0}}
"""


def test_a_motion_that_ends_early_is_shorter_and_one_that_cannot_begin_says_why(tmp_path):
    """u' = 1 + u^2 from 1 ends at pi/4; the motion of the report goes on as far as it is known."""
    model = codegen.parse_model(BLOWING_UP)
    blow = codegen.load(codegen.generate(model, tmp_path / "blow").folder)
    core, skipped = Core.compiled(tmp_path), []
    found = motions.motions(model, blow, 3.0, skipped, lambda partitions: blow, core)
    assert found["end"] == pytest.approx(0.8 * np.pi / 4, abs=0.01) and "t = 0.785" in found["ended"]
    assert found["methods"]["dop853"] and not skipped
    model = codegen.parse_model(BLOWING_UP.replace("1 + u.cart**2", "log(q.cart)").replace("blow", "nowhere"))
    nowhere = codegen.load(codegen.generate(model, tmp_path / "nowhere").folder)
    assert motions.motions(model, nowhere, 3.0, skipped, lambda partitions: nowhere, core) is None
    assert "the time derivative of u.cart is not finite" in skipped[0].why
    with pytest.warns(RuntimeWarning, match="is not finite"):
        x = nowhere.simulate([0.0, 1.0], sensitivities="gain", on_failure="return")
    assert len(x) == 0 and x.dq.shape == (1, 0, 1)
