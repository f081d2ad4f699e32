"""``ordernm bench`` on the command line: tables, JSON, comparison, page, exit codes; and the functions that it calls."""

import copy
import json
import math
import time

import pytest

from codegen.bench import command, lines, measuring, page, results, work_precision
from codegen.bench.catalogue import PROBLEMS
from codegen.bench.problem import Goal, Setting
from codegen.cli import main
from codegen.measure import accuracy, clock
from codegen.runtime import NoCompilerError


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The printed lines, the JSON and the page of one quick run of a motion and a family."""
    folder = tmp_path_factory.mktemp("run")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ORDERNM_CFLAGS", "-O0")
        patch.chdir(folder)
        from io import StringIO

        out = StringIO()
        patch.setattr("sys.stdout", out)
        code = main(["bench", "--quick", "cart_pole", "coiled", "-o", "new.json", "--page", "page.md"])
    return code, out.getvalue(), json.loads((folder / "new.json").read_text()), (folder / "page.md").read_text(), folder


def test_a_run_prints_errors_work_times_and_operations(run):
    code, text, *_ = run
    assert code == 0
    assert "cart_pole: a light cart with a pole, 10 s" in text and "reference: one quadrature, t(theta)" in text
    assert "evaluations" in text and "additions and multiplications an evaluation" in text
    assert "coiled: a coiled planar chain" in text and "udot + 8" in text


def test_the_json_has_machine_points_and_sizes(run):
    found = run[2]
    assert found["format"] == results.FORMAT and found["quick"] is True
    assert found["machine"]["flags"].endswith("-O0")
    (point,) = found["problems"]["cart_pole"]["points"]
    assert point["error"] < 1e-6 and point["seconds"] > 0 and point["ended"] == "finished"
    (row,) = found["problems"]["coiled"]["sizes"]
    of_all = {"udot", "first joint", "middle joint", "all joints", "length", "all speeds"}
    of_each = {f"{words}{i}" for words in ("joint ", "speed of joint ") for i in range(1, 11)}
    assert row["errors"].keys() == of_all | of_each
    assert row["error"] == max(row["errors"].values()) < 1e-13
    assert row["seconds"].keys() == {"udot", "udot + 8"} and min(row["seconds"].values()) > 0


def test_the_page_names_the_machine_and_has_the_tables(run):
    text = run[3]
    assert text.startswith("# How accurate, how fast\n")
    assert run[2]["machine"]["instructions"] in text and "-O0" in text
    assert "| a coiled planar chain, 22.5 degrees at each joint | 10 |" in text
    rows = [line.count("|") for line in text.splitlines() if line.startswith("|")]
    assert len(rows) > 8
    assert page.page_of(run[2]) == text, "the same page from the JSON"


def test_long_chains_have_the_worst_of_joints_and_each_column_under_its_head(run):
    row = run[2]["problems"]["coiled"]["sizes"][0]
    less = {n: x for n, x in row["errors"].items() if "speed" not in n} | {"joint 7": 0.5}
    text = page._digits({"a": {"title": "coiled", "source": "s", "sizes": [row]},
                         "b": {"title": "straight", "source": "s", "sizes": [row | {"errors": less}]}})[1]  # fmt: skip
    head, _, coiled, straight = (line.split("|") for line in text.splitlines())
    column = {name.strip(): i for i, name in enumerate(head)}
    assert straight[column["by any one joint"]].strip() == "5.0e-01"
    assert straight[column["by all speeds"]].strip() == straight[column["by any one speed"]].strip() == ""
    speeds = [x for n, x in row["errors"].items() if n.startswith("speed of joint ")]
    assert len(speeds) == 10 and coiled[column["by any one speed"]].strip() == f"{max(speeds):.1e}"


def test_a_run_is_compared_with_itself(run, capsys, monkeypatch):
    monkeypatch.chdir(run[4])
    assert main(["bench", "--results", "new.json", "--compare", "new.json"]) == 0
    table = capsys.readouterr().out.split("\n\n")[-1]
    assert table.count("1.00") == 3, "a setting and two functions"
    assert "another machine" not in table


def test_another_machine_and_other_figures_are_told(run):
    old = copy.deepcopy(run[2])
    old["machine"]["flags"] = "-O3"
    old["problems"]["cart_pole"]["points"][0]["seconds"] *= 2
    found = lines.compare_lines(run[2], old, None)
    assert found[0].startswith("warning: another machine: flags: -O3 then, ")
    assert found[2].endswith(" 0.50")
    del old["problems"]
    old["problems"] = {}
    assert lines.compare_lines(run[2], old, None)[-1] == "the two runs have no results in common"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["andrew"], "bench: there is no problem 'andrew'; there are pendulum, "),
        (
            ["--compare", "absent.json"],
            "bench: absent.json cannot be read: No such file or directory; give a file that",
        ),
        (["--compare", "broken.json"], "bench: broken.json is not valid JSON ("),
        (["--compare", "other.json"], "bench: other.json does not contain benchmark results; give a file that"),
        (["--compare", "list.json"], "bench: list.json does not contain benchmark results"),
        (["--compare", "later.json"], "bench: later.json has format 99; this version reads format 1. Measure again"),
        (["-o", "nowhere/new.json"], "bench: -o: cannot write nowhere/new.json: there is no folder"),
        (["--page", "."], "bench: --page: . is a folder; give the name of a file"),
        (["--results", "later.json", "--quick"], "bench: --results takes an earlier run"),
    ],
)
def test_what_cannot_be_done_is_told_before_the_work(arguments, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name, text in (("broken", "{"), ("other", '{"a": 1}'), ("list", "[1]"), ("later", '{"format": 99}')):
        (tmp_path / f"{name}.json").write_text(text)
    monkeypatch.setattr(command, "run", lambda *a: pytest.fail("nothing is to be measured"))
    assert main(["bench", *arguments]) == 2
    assert capsys.readouterr().err.startswith(message)


def test_without_a_compiler_it_says_so(monkeypatch, capsys):
    monkeypatch.setenv("CC", "no-such-compiler")
    assert main(["bench", "--quick", "cart_pole"]) == 3
    error = capsys.readouterr().err
    assert error.startswith("bench: no C compiler found: CC=no-such-compiler was not found; install gcc or clang")
    with pytest.raises(NoCompilerError):
        from codegen.measure.machine import machine

        machine()


def test_figures_that_are_off_end_in_an_exit_code(run, monkeypatch, capsys, tmp_path):
    wrong = copy.deepcopy(run[2])
    wrong["problems"]["cart_pole"]["failed"] = ["dop853 1e-09"]
    results.write_results(wrong, tmp_path / "wrong.json")
    assert main(["bench", "--results", str(tmp_path / "wrong.json")]) == 4
    assert capsys.readouterr().err == "bench: cart_pole: dop853 1e-09\n"


def test_the_list_has_every_problem(capsys):
    assert main(["bench", "--list"]) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == list(PROBLEMS)


def test_runs_of_parts_make_one(run, monkeypatch, capsys):
    whole = run[2]
    parts = [{**whole, "problems": {name: result}} for name, result in whole["problems"].items()]
    for part, name in zip(parts, ("a", "b"), strict=True):
        results.write_results(part, run[4] / f"{name}.json")
    monkeypatch.chdir(run[4])
    assert main(["bench", "--results", "a.json", "--results", "b.json", "-o", "whole.json"]) == 0
    assert json.loads((run[4] / "whole.json").read_text()) == whole
    for change, message in (
        ({"quick": False}, "--quick"),
        ({"machine": {**whole["machine"], "flags": "-O3"}}, "flags: "),
    ):
        results.write_results({**parts[1], **change}, run[4] / "b.json")
        capsys.readouterr()
        assert main(["bench", "--results", "a.json", "--results", "b.json"]) == 2
        assert message in capsys.readouterr().err


@pytest.mark.parametrize("options", [[], ["--page", "other.md", "--plots", "pictures"]])
def test_results_that_cannot_be_printed_are_refused(run, monkeypatch, capsys, options):
    """What `compare` does not read may be damaged, too."""
    monkeypatch.chdir(run[4])
    for damage in ({"operations": None}, {"points": [run[2]["problems"]["cart_pole"]["points"][0] | {"ended": 3}]}):
        problem = run[2]["problems"]["cart_pole"] | damage
        results.write_results({**run[2], "problems": {"cart_pole": problem}}, run[4] / "damaged.json")
        assert main(["bench", "--results", "damaged.json", *options]) == 2
        assert "bench: damaged.json: damaged, or of another version: " in capsys.readouterr().err
    assert not (run[4] / "other.md").exists() and not (run[4] / "pictures").exists()


# -- work-precision diagrams -----------------------------------------------------------------------------------------------


def points(*rows):
    return [
        work_precision.Point(Setting("dop853", 10.0**-i, 10.0**-i), error, n, n // 12, 0, seconds, "finished")
        for i, (error, n, seconds) in enumerate(rows)
    ]


DIAGRAM = points((1e-4, 100, 1e-3), (1e-6, 200, 2e-3), (2e-6, 300, 5e-3), (1e-8, 400, 4e-3), (math.nan, 50, 1e-4))


def test_the_cheapest_and_the_fastest_setting_that_reach_an_error():
    assert work_precision.best(DIAGRAM, 1e-5).evaluations == 200
    assert work_precision.best(DIAGRAM, 1e-7, "seconds").seconds == 4e-3
    assert work_precision.best(DIAGRAM, 1e-9) is None


def test_an_interrupt_is_not_taken_for_a_motion_that_ends_early():
    class Interrupted:
        def simulate(self, *arguments, **options):
            return type("Some", (), {"stats": {"reason": "interrupted"}})()

    with pytest.raises(KeyboardInterrupt):
        work_precision.integrate(Interrupted(), 1.0, Setting("dop853", 1e-6, 1e-6))


def test_the_time_at_an_error_is_between_points_that_no_other_beats():
    assert work_precision.seconds_at(DIAGRAM, 1e-5) == pytest.approx(math.sqrt(2) * 1e-3, rel=1e-12)
    assert work_precision.seconds_at(DIAGRAM, 1e-8) == pytest.approx(4e-3, rel=1e-12)
    assert math.isnan(work_precision.seconds_at(DIAGRAM, 1e-9))


def test_goals_count_errors_evaluations_and_times():
    def verdict(goal):
        found = measuring._goal(goal, DIAGRAM)
        return found["met"], found["slow"]

    assert verdict(Goal(1e-7)) == (True, False)
    assert verdict(Goal(1e-9)) == (False, False)
    assert verdict(Goal(1e-7, evaluations=400)) == (False, False)
    assert verdict(Goal(1e-7, evaluations=401)) == (True, False)
    assert verdict(Goal(1e-7, seconds=1e-3)) == (False, True)
    assert "missed at all tolerances" in lines.goal_line(measuring._goal(Goal(1e-9), DIAGRAM))


def test_contestants_take_turns():
    order = []

    def contestant(name):
        def run():
            order.append(name)
            return float(len(order))

        return run

    found = clock.alternate({"a": contestant("a"), "b": contestant("b")}, budget=0.0, least_turns=3)
    assert order == ["a", "b", "a", "b", "a", "b"]
    assert found["a"] == clock.Seconds(1.0, 3.0, 5.0, 3)
    slept = clock.elapsed(lambda: time.sleep(0.002), 3)()
    assert 0.002 <= slept < 1.0


def test_exponents_of_growth():
    assert clock.exponent([10, 100, 1000], [2e-6, 2e-4, 2e-2]) == pytest.approx(2.0)
    assert math.isnan(clock.exponent([10], [1.0]))


def test_relative_errors_are_by_direction():
    found = accuracy.by_direction([[1.0, 2.0 + 2e-10], [10.0, 1e-9], [1e-12, 0.0]], [[1, 2], [10, 0], [0, 0]])
    assert found == pytest.approx([1e-10, 1e-10, 1e-12], rel=1e-5)


@pytest.mark.parametrize("names", [["pendulum"], ["--quick", "chain"]])
def test_pictures_of_nothing_are_refused_before_the_work(names, monkeypatch, capsys, tmp_path):
    """A family has a picture at several sizes only, and one is measured with --quick."""
    pytest.importorskip("matplotlib")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(command, "run", lambda *a: pytest.fail("nothing is to be measured"))
    assert main(["bench", *names, "--plots", "pictures"]) == 2
    assert capsys.readouterr().err.startswith("bench: --plots: no selected problem has a picture; select a family")
    assert not list(tmp_path.iterdir())
