"""The list of long tests names existing functions, and every folder of tests has quick tests."""

from __future__ import annotations

import re
from collections import Counter
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

from tiers import (
    ALWAYS,
    CAMPAIGN,
    FACTOR,
    LIMIT,
    campaign_cases,
    function_of,
    long_functions,
    mark_campaign,
    missing_and_outdated,
    recorded,
    skipped,
    sort_by_length,
)

TESTS = Path(__file__).parent


def functions() -> set[str]:
    """Names of all test functions."""
    return {
        f"tests/{file.relative_to(TESTS).as_posix()}::{name}"
        for file in TESTS.rglob("test_*.py")
        for name in re.findall(r"^def (test_\w+)\(", file.read_text(encoding="utf-8"), re.MULTILINE)
    }


def test_what_always_runs_exists_and_is_long() -> None:
    assert {function_of(n) for n in ALWAYS} <= functions() & long_functions()


def test_what_is_left_to_the_campaign_exists() -> None:
    assert {function_of(n) for n in campaign_cases()} <= functions()


def test_functions_left_to_the_campaign_have_a_note_of_what_stays() -> None:
    lines = CAMPAIGN.read_text(encoding="utf-8").splitlines()
    functions = {n for n in campaign_cases() if "[" not in n}
    assert all(before.startswith("# ") for before, n in pairwise(lines) if n in functions)
    assert not {n for n in campaign_cases() if "[" in n and function_of(n) in functions}


def test_functions_and_single_cases_are_left_to_the_campaign() -> None:
    case, function = (next(n for n in campaign_cases() if ("[" in n) == x) for x in (True, False))
    left: list[str] = []
    items = [
        SimpleNamespace(nodeid=n, add_marker=lambda _, n=n: left.append(n))
        for n in (case, f"{function_of(case)}[no case]", function, f"{function}[0]", f"{function}_too")
    ]
    mark_campaign(items)
    assert left == [case, function, f"{function}[0]"]


def test_what_always_runs_is_not_left_to_the_campaign() -> None:
    assert set(ALWAYS).isdisjoint(campaign_cases()) and set(map(function_of, ALWAYS)).isdisjoint(campaign_cases())


def test_quick_functions_stand_in_every_folder() -> None:
    known = functions()
    folders = {n.rpartition("/")[0] for n in known}
    assert folders == {n.rpartition("/")[0] for n in (known - long_functions()) | set(map(function_of, ALWAYS))}


def test_times_of_a_run_are_those_of_functions(tmp_path: Path) -> None:
    case = """<testcase classname="tests.model.test_units" name="test_{}" time="9.0">
        <properties><property name="cpu" value="{}"/></properties></testcase>"""
    cases = "".join(case.format(*x) for x in (("a[1]", 0.5), ("a[x.y[0]]", 0.75), ("b", 0.125)))
    (tmp_path / "run.xml").write_text(f"<testsuites><testsuite>{cases}</testsuite></testsuites>")
    name = "tests/model/test_units.py::test_"
    assert recorded(tmp_path / "run.xml") == {f"{name}a": 1.25, f"{name}b": 0.125}


def test_files_with_most_long_functions_come_first() -> None:
    """A file that is not listed has none; tests of a file keep their order."""
    known = Counter(name.partition("::")[0] for name in long_functions())
    (most, n), (least, m) = known.most_common(1)[0], known.most_common()[-1]
    assert n > m
    items = [SimpleNamespace(nodeid=f"{file}::test_{x}") for x in "ba" for file in ("tests/short.py", least, most)]
    sort_by_length(items)
    assert [i.nodeid for i in items] == [f"{file}::test_{x}" for file in (most, least, "tests/short.py") for x in "ba"]


def test_what_changed_by_far_is_reported() -> None:
    times = Counter({"slow": 1.1 * FACTOR * LIMIT, "near": 1.1 * LIMIT, "listed": 1.1 * LIMIT, "fast": 0.01})
    assert missing_and_outdated(times, {"listed", "fast", "gone"}, set()) == (["slow"], ["fast", "gone"])


def test_nothing_is_said_of_the_time_of_skipped_functions(tmp_path: Path) -> None:
    case = '<testcase classname="{}" name="{}">{}</testcase>'
    cases = "".join(
        case.format(*x)
        for x in (
            ("", "tests.fmu.test_units", "<skipped/>"),
            ("tests.learning.test_jax", "test_a[1]", "<skipped/>"),
            ("tests.learning.test_jax", "test_b", ""),
        )
    )
    (tmp_path / "run.xml").write_text(f"<testsuites><testsuite>{cases}</testsuite></testsuites>")
    unknown = skipped(tmp_path / "run.xml")
    assert unknown == {"tests/fmu/test_units.py", "tests/learning/test_jax.py::test_a"}
    listed = {"tests/fmu/test_units.py::test_c", *(f"tests/learning/test_jax.py::test_{n}" for n in "ab")}
    assert missing_and_outdated(Counter(), listed, unknown)[1] == ["tests/learning/test_jax.py::test_b"]
