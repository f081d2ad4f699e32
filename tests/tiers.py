"""Selects quick tests, and reports the times of tests in a recorded run."""

from __future__ import annotations

import argparse
import resource
import time
import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Iterable, Sequence, Set
from pathlib import Path

import pytest

LIMIT = 0.3
"""CPU seconds of all cases of a quick function."""
FACTOR = 3.0
"""A listed function stays on the list, and an unlisted one stays off it, within this factor, because times vary."""
LIST = Path(__file__).with_name("long_tests.txt")
CAMPAIGN = Path(__file__).with_name("campaign_cases.txt")
"""Cases that only the campaign runs, and what stays for them in the ordinary run."""

ALWAYS = (
    "tests/examples/test_models.py::test_a_solver_agrees_with_a_reference_engine[four_bar]",
    "tests/examples/test_models.py::test_a_solver_agrees_with_a_reference_engine[shaken_pendulum]",
    "tests/importing/test_mjcf.py::test_loops_move_as_mujocos_matrices_say[connect]",
    "tests/importing/test_pinocchio_models.py::test_every_type_of_joint_moves_as_pinocchio_says[PZ]",
    "tests/learning/test_jax.py::test_single_precision",
    "tests/outputs/test_generated.py::test_generated_and_both_engines_agree[tree-11]",
    "tests/second/test_measures.py::test_random_trees_agree_with_differences_in_40_digits[1-energy_hessian_products]",
    "tests/second/test_memory.py::test_trees[0-inverse]",
    "tests/test_generation.py::test_both_targets_agree_when_loaded",
)
"""From model to solver in both targets, trees and loops; and one case of each kind that is long in all cases."""


def long_functions() -> set[str]:
    """Names of long test functions, as pytest lists them without the case."""
    return set(LIST.read_text(encoding="utf-8").split())


def function_of(nodeid: str) -> str:
    """The name of a test without its case."""
    return nodeid.partition("[")[0]


def campaign_cases() -> set[str]:
    """Names of tests with their cases, and of functions of which all cases are meant."""
    lines = CAMPAIGN.read_text(encoding="utf-8").splitlines()
    return {line for line in lines if line and not line.startswith("#")}


def mark_campaign(items: Iterable[pytest.Item]) -> None:
    """Give the listed cases and functions the marker ``campaign``."""
    listed = campaign_cases()
    for item in items:
        if not listed.isdisjoint((item.nodeid, function_of(item.nodeid))):
            item.add_marker("campaign")


def mark_quick(items: Iterable[pytest.Item]) -> None:
    """Give quick tests the marker ``quick``."""
    long = long_functions()
    items = [i for i in items if isinstance(i, pytest.Function) and i.get_closest_marker("campaign") is None]
    waited_for = {f for item in items if function_of(item.nodeid) in long for f in _fixtures_of_file(item)}
    for item in items:
        quick = function_of(item.nodeid) not in long and waited_for.isdisjoint(_fixtures_of_file(item))
        if quick or item.nodeid in ALWAYS:
            item.add_marker("quick")


def sort_by_length(items: list[pytest.Item]) -> None:
    """Put files with most long functions first, so that no process is left alone with a long file."""
    long = Counter(function.partition("::")[0] for function in long_functions())

    def place(item: pytest.Item) -> tuple[int, str]:
        file = item.nodeid.partition("::")[0]
        return -long[file], file

    items.sort(key=place)


def _fixtures_of_file(item: pytest.Function) -> set[tuple[str, str]]:
    """File and name of the fixtures that a test shares with other tests of its file."""
    file = item.nodeid.partition("::")[0]
    definitions = item._fixtureinfo.name2fixturedefs
    return {(file, n) for n, known in definitions.items() if known[-1].scope != "function" and known[-1].baseid == file}


def cpu_seconds() -> float:
    """CPU seconds of this process and of its ended child processes."""
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + ended.ru_utime + ended.ru_stime


def recorded(file: Path) -> Counter[str]:
    """CPU seconds of each test function in a JUnit file of pytest, its fixtures included."""
    found: Counter[str] = Counter()
    for case in ElementTree.parse(file).iter("testcase"):
        given = case.find("properties/property[@name='cpu']")
        found[_function(case)] += 0.0 if given is None else float(given.attrib["value"])
    return found


def _function(case: ElementTree.Element) -> str:
    """The test function of a case in a JUnit file, or the file of tests that was skipped as a whole."""
    module, name = case.attrib["classname"], case.attrib["name"]
    file = f"{(module or name).replace('.', '/')}.py"
    return function_of(f"{file}::{name}") if module else file


def skipped(file: Path) -> set[str]:
    """Test functions with skipped cases, and files that were skipped: their times in a JUnit file are not known."""
    cases = ElementTree.parse(file).iter("testcase")
    return {_function(case) for case in cases if case.find("skipped") is not None}


def missing_and_outdated(times: Counter[str], known: set[str], skipped: Set[str]) -> tuple[list[str], list[str]]:
    """Functions that are missing on the list, and listed ones that do not exist or are much too quick.

    Nothing is said of listed functions that were skipped, or whose files were.
    """
    missing = [n for n, seconds in times.most_common() if n not in known and seconds > LIMIT * FACTOR]
    return missing, sorted(n for n in known if times[n] < LIMIT / FACTOR and not _is_of(n, skipped))


def _is_of(function: str, places: Set[str]) -> bool:
    """Whether functions and files contain a function."""
    return function in places or function.partition("::")[0] in places


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the times of a recorded run, or write a new list."""
    parser = argparse.ArgumentParser(description="Times of test functions in a JUnit file of pytest.")
    parser.add_argument("file", type=Path)
    parser.add_argument("--write", action="store_true", help="write the list of long test functions")
    asked = parser.parse_args(arguments)
    times, unknown = recorded(asked.file), skipped(asked.file)
    if asked.write:
        long = {n for n in times if times[n] >= LIMIT} | {n for n in long_functions() if _is_of(n, unknown)}
        LIST.write_text("".join(f"{n}\n" for n in sorted(long)), encoding="utf-8")
        return
    files: Counter[str] = Counter()
    for name, seconds in times.items():
        files[name.partition("::")[0]] += seconds
    print(
        f"{files.total():.0f} CPU s in {len(times)} test functions; the longest files, and functions with all their cases:"
    )
    for name, seconds in (*files.most_common(20), *times.most_common(20)):
        print(f"{seconds:8.1f} s  {name}")
    missing, outdated = missing_and_outdated(times, long_functions(), unknown)
    for title, names in (("missing from", missing), ("no longer long, but in", outdated)):
        if names:
            print(f"{title} tests/{LIST.name}:", *names, sep="\n  ")


if __name__ == "__main__":
    main()
