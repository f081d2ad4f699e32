"""The numbers of a report are the solver's own: report.json is computed once more, from the model and the states in it.

A second report of the model computes the same; what differs is found and named.
"""

import contextlib
import copy
import io
import json
import os
import re
import shutil
from pathlib import Path

import mpmath
import numpy as np
import pytest

import codegen
from codegen.cli import main
from codegen.measure.core import Core, Turn, record
from codegen.reference import RecursiveEngine
from codegen.reporting import Request, figures, integrating, motions, processes, report
from codegen.reporting.agreement import SPREAD, NoReportError, agreed, disagreements, read, read_gallery
from codegen.reporting.errors import DIGITS
from codegen.reporting.states import State

pytest.importorskip("matplotlib", reason="reports draw figures; the extra plot installs matplotlib")

EXAMPLES = Path(__file__).parents[2] / "examples"
MODEL = EXAMPLES / "slider_crank.yaml"
END = 0.4
QUICK = Request(end=END, timing=0.005, reference=300.0)
TIMES = re.compile("seconds of|peak, ")


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    """The folder of a report of the slider-crank, whose times come from two processes."""
    folder = tmp_path_factory.mktemp("first") / "report"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(processes, "PROCESSES", 2)
        report(MODEL, folder, request=QUICK)
    return folder


@pytest.fixture(scope="module")
def numbers(first):
    return json.loads((first / "report.json").read_text())


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return codegen.generate(MODEL, tmp_path_factory.mktemp("solver") / "package", check=False)


@pytest.fixture(scope="module")
def solver(made):
    """A solver that is compiled like the report's."""
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


def test_times_are_of_several_processes(numbers, solver, tmp_path, monkeypatch):
    """A motion that takes long is timed twice, a short one by every process; functions by all of them."""
    monkeypatch.setattr(processes, "PROCESSES", 3)
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
    with pytest.raises(RuntimeError, match="contains no complete generated solver"):
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


# ---- two reports ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def command(first, tmp_path_factory):
    """Folders of two reports of the slider-crank, the second by the command in the place of a changed copy of the first; and
    the exit code of the command, and what it said. Two processes take the times of the second.
    """
    second = tmp_path_factory.mktemp("second") / "report"
    shutil.copytree(first, second)
    data = json.loads((second / "report.json").read_text())
    data["generated"]["kinds"] += 1
    (second / "report.json").write_text(json.dumps(data))
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(io.StringIO()) as said:
        patch.setattr("codegen.reporting.Request", lambda end: QUICK)
        patch.setattr(processes, "PROCESSES", 2)
        code = main(["report", str(MODEL), "-o", str(second), "--compare", str(second)])
    return (first, second), code, said.getvalue()


@pytest.fixture
def twice(command):
    return command[0]


@pytest.fixture
def one(first):
    return read(first)


def test_a_second_run_computes_the_same(twice):
    """Times are left to a machine with nothing else to do; in tests they are taken for an instant."""
    found = [x for x in disagreements(*map(read, twice), most=1000) if not TIMES.match(x)]
    assert found == []


def test_a_report_agrees_with_itself(one):
    assert disagreements(one, copy.deepcopy(one)) == []


def entry(path):
    """Change a number of a report."""

    def change(data, by):
        *way, last = path
        for key in way:
            data = data[key]
        data[last] = by(data[last])

    return change


@pytest.mark.parametrize(
    ("path", "by", "told"),
    [
        (("generated", "kinds"), lambda x: x + 1, r"generated\.kinds is \d+ in one report and \d+ in the other"),
        (("generated", "operations", "accelerations"), lambda x: {}, r"only one report has .*\.accelerations"),
        (("states", 0, "q", 0), lambda x: x * (1 + 1e-8), r"states\[0\]\.q\[0\]"),
        (("errors", 1, "udot"), lambda x: x + 1e-15, "errors at many turns: udot"),
        (("errors", 0, "estimates"), lambda x: {k: 2 * e for k, e in x.items()}, "errors at random 1: estimates"),
        (("errors", 0, "jacobians"), lambda x: 2 * x + 1e-16, "errors at random 1: jacobians"),
        (("differences", "central", 10), lambda x: 1.0 + (x or 0), r"differences\.central\[10\]"),
        (
            ("motions", "methods", "dop853"),
            lambda x: x[1:],
            r"motions\.methods\.dop853 has \d+ entries in one report and \d+ in the other",
        ),
        (("motions", "methods", "radau", 0, "evaluations"), lambda x: x + 1, r"radau\[0\]\.evaluations"),
        (("motions", "conditions", "closures", 5), lambda x: 1.1 * x, r"motions\.conditions\.closures\[5\]"),
    ],
)
def test_what_differs_is_named(one, path, by, told):
    other = copy.deepcopy(one)
    entry(path)(other, by)
    for pair in ((one, other), (other, one)):
        assert any(re.search(told, x) for x in disagreements(*pair))


def test_times_may_differ_within_their_spread(one):
    inside, outside = copy.deepcopy(one), copy.deepcopy(one)
    taken = one["times"]["functions"]["udot"]["compiled"]
    for data, factor in ((inside, 1 + 0.9 * SPREAD), (outside, 1 + 1.1 * SPREAD)):
        record = data["times"]["functions"]["udot"]["compiled"]
        for key in ("least", "median", "high"):
            record[key] = factor * taken["high"]
    assert disagreements(one, inside) == []
    (told,) = disagreements(outside, one)
    assert told.startswith("seconds of udot, in C: ")


@pytest.mark.parametrize("work", ["core", "cache"])
@pytest.mark.parametrize("which", ["this", "earlier"])
def test_a_slower_core_is_no_difference(one, which, work):
    """What took ten times as long beside fixed work that took as much longer agrees; slower times alone do not."""
    slow, faster = copy.deepcopy(one), copy.deepcopy(one)
    for times in (x["compiled"] for x in slow["times"]["functions"].values()):
        for key in ("least", "median", "high", work):
            times[key] *= 10
    slow["times"][work]["median"] *= 10
    pair = (one, slow) if which == "this" else (slow, one)
    assert disagreements(*pair) == []
    assert agreed(*pair).endswith(f"fixed work now takes {10.0 if which == 'this' else 0.1:.2f} times as long")
    assert agreed(one, one) == "agrees with the earlier report"
    udot = slow["times"]["functions"]["udot"]["compiled"]
    for key in ("least", "median", "high"):
        udot[key] *= 30  # more than the square
    (told,) = disagreements(*pair)
    assert told.startswith("seconds of udot, in C: ") and "; fixed work now takes " in told
    for times in (x["compiled"] for x in faster["times"]["functions"].values()):
        for key in ("least", "median", "high"):
            times[key] /= 10  # beside a core that was as fast
    assert disagreements(one, faster)


@pytest.mark.parametrize("what", ["batches", "roofline", "motions"])
def test_every_time_has_a_spread(one, what):
    other = copy.deepcopy(one)
    if what == "batches":
        records = list(other["times"]["batches"].values())
    elif what == "roofline":
        records = [other["roofline"][k] for k in ("peaks", "peaks_low")]
    else:
        records = [p for points in other["motions"]["methods"].values() for p in points]
    for times in records:
        for key in times:
            if key in ("least", "median", "high", "seconds", "seconds_high") or what == "roofline":
                times[key] *= 1e3
    found = disagreements(one, other)
    assert len(found) >= 4 and all(TIMES.match(x) or x.startswith("and ") for x in found)


def test_states_that_only_one_had_time_for_are_no_difference(one):
    other = copy.deepcopy(one)
    del other["errors"][2]
    assert any("errors are at the states" in x for x in disagreements(one, other))
    left_out = {
        "what": "errors at state 'random 3'",
        "why": "the reference has used its 12 s",
        "seconds": 2.0,
        "text": "",
    }
    other["skipped"].append(left_out)
    assert disagreements(one, other) == []


def test_other_machines_and_models(one):
    other = copy.deepcopy(one)
    other["machine"]["compiler"] = "another one"
    assert disagreements(one, other) == [
        f"the reports are from different machines: compiler: {one['machine']['compiler']}, another one"
    ]
    other["model"] = "rods"
    assert disagreements(one, other) == ["the reports are of different models, slider_crank and rods"]


def test_what_is_no_report_is_refused_before_the_work(tmp_path, capsys):
    (tmp_path / "report.json").write_text("[]")
    command = ["report", str(EXAMPLES / "pendulum.yaml"), "-o", str(tmp_path / "new"), "--compare"]
    for place in (tmp_path / "report.json", tmp_path / "none"):
        assert main([*command, str(place)]) == 2
        assert "--compare" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()
    with pytest.raises(NoReportError, match="no folders"):
        read_gallery(tmp_path)


def test_the_command_tells_what_differs(command):
    """Also where the new report takes the place of the old one."""
    _, code, said = command
    assert code == 4
    assert re.search(r"slider_crank: generated\.kinds is \d+ in one report and \d+ in the other", said)
