"""Two reports of a model: what is computed is the same in both, and what differs is found and named."""

import contextlib
import copy
import io
import json
import re
import shutil
from pathlib import Path

import pytest

from codegen.cli import main
from codegen.reporting import Request, report
from codegen.reporting.agreement import SPREAD, NoReportError, agreed, disagreements, read, read_gallery

pytest.importorskip("matplotlib", reason="reports draw figures; the extra plot installs matplotlib")

EXAMPLES = Path(__file__).parents[2] / "examples"
QUICK = Request(end=0.2, timing=0.005, reference=300.0)
TIMES = re.compile("seconds of|peak, ")


@pytest.fixture(scope="module")
def command(tmp_path_factory):
    """Folders of two reports of the slider-crank, the second by the command in the place of a changed copy of the first; and
    the exit code of the command, and what it said.
    """
    first, second = (tmp_path_factory.mktemp(name) / "report" for name in ("first", "second"))
    report(EXAMPLES / "slider_crank.yaml", first, request=QUICK)
    shutil.copytree(first, second)
    data = json.loads((second / "report.json").read_text())
    data["generated"]["kinds"] += 1
    (second / "report.json").write_text(json.dumps(data))
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(io.StringIO()) as said:
        patch.setattr("codegen.reporting.Request", lambda end: QUICK)
        code = main(["report", str(EXAMPLES / "slider_crank.yaml"), "-o", str(second), "--compare", str(second)])
    return (first, second), code, said.getvalue()


@pytest.fixture
def twice(command):
    return command[0]


@pytest.fixture
def one(twice):
    return read(twice[0])


def test_a_second_run_computes_the_same(twice):
    """Times are left to a machine with nothing else to do; in tests they are taken for an instant."""
    found = [x for x in disagreements(*map(read, twice), most=1000) if not TIMES.match(x)]
    assert found == []


def test_a_report_agrees_with_itself(one):
    assert disagreements(one, copy.deepcopy(one)) == []


def entry(path):
    """Changes the number at a place of a report."""

    def change(data, by):
        *way, last = path
        for key in way:
            data = data[key]
        data[last] = by(data[last])

    return change


@pytest.mark.parametrize(
    ("path", "by", "told"),
    [
        (("generated", "kinds"), lambda x: x + 1, r"generated\.kinds is \d+, and \d+"),
        (("generated", "operations", "accelerations"), lambda x: {}, r"generated\.operations\.accelerations\..* only"),
        (("states", 0, "q", 0), lambda x: x * (1 + 1e-8), r"states\[0\]\.q\[0\]"),
        (("errors", 1, "udot"), lambda x: x + 1e-15, "errors at many turns: udot"),
        (("errors", 0, "estimates"), lambda x: {k: 2 * e for k, e in x.items()}, "errors at random 1: estimates"),
        (("errors", 0, "jacobians"), lambda x: 2 * x + 1e-16, "errors at random 1: jacobians"),
        (("differences", "central", 10), lambda x: 1.0 + (x or 0), r"differences\.central\[10\]"),
        (("motions", "methods", "dop853"), lambda x: x[1:], r"motions\.methods\.dop853 has \d+ entries, and \d+"),
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
    for record in (x["compiled"] for x in slow["times"]["functions"].values()):
        for key in ("least", "median", "high", work):
            record[key] *= 10
    slow["times"][work]["median"] *= 10
    pair = (one, slow) if which == "this" else (slow, one)
    assert disagreements(*pair) == []
    assert agreed(*pair).endswith(f"fixed work takes {10.0 if which == 'this' else 0.1:.2f} times as long now")
    assert agreed(one, one) == "agrees with the earlier report"
    udot = slow["times"]["functions"]["udot"]["compiled"]
    for key in ("least", "median", "high"):
        udot[key] *= 30  # more than the square
    (told,) = disagreements(*pair)
    assert told.startswith("seconds of udot, in C: ") and "; fixed work takes " in told
    for record in (x["compiled"] for x in faster["times"]["functions"].values()):
        for key in ("least", "median", "high"):
            record[key] /= 10  # beside a core that was as fast
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
    for record in records:
        for key in record:
            if key in ("least", "median", "high", "seconds", "seconds_high") or what == "roofline":
                record[key] *= 1e3
    found = disagreements(one, other)
    assert len(found) >= 4 and all(TIMES.match(x) or x.startswith("and ") for x in found)


def test_states_that_only_one_had_time_for_are_no_difference(one):
    other = copy.deepcopy(one)
    del other["errors"][2]
    assert any("errors are at the states" in x for x in disagreements(one, other))
    left_out = {
        "what": "errors at state 'random 3'",
        "why": "the reference has had its 12 s",
        "seconds": 2.0,
        "text": "",
    }
    other["skipped"].append(left_out)
    assert disagreements(one, other) == []


def test_other_machines_and_models(one):
    other = copy.deepcopy(one)
    other["machine"]["compiler"] = "another one"
    assert disagreements(one, other) == [
        f"they are of different machines: compiler: {one['machine']['compiler']}, another one"
    ]
    other["model"] = "rods"
    assert disagreements(one, other) == ["they are of different models, slider_crank and rods"]


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
    assert re.search(r"slider_crank: generated\.kinds is \d+, and \d+", said)
