"""Every problem of `ordernm bench` at its cheap setting, with the code that measures it; all settings in the campaign."""

import pytest

from codegen.bench.catalogue import PROBLEMS
from codegen.bench.measuring import measure
from codegen.bench.problem import Motion
from codegen.measure.machine import machine

ELSEWHERE = ("robots",)
"""In test_robots.py: what they need is not everywhere."""
LARGE = ("four_bars_5", "four_bars_10", "four_bars_20", "four_bars_40", "long_pendulum")
"""Left to the campaign: a model or a motion that takes seconds, and a small one like it is here."""

MEASURED: dict[str, dict] = {}


@pytest.mark.parametrize("name", [n for n in PROBLEMS if n not in LARGE + ELSEWHERE])
def test_a_problem_keeps_its_error_at_a_cheap_setting(name, tmp_path, monkeypatch):
    monkeypatch.setenv("ORDERNM_CFLAGS", "-Og")
    told = []
    result = measure(PROBLEMS[name], tmp_path, True, told.append, budget=0.0)
    assert result["failed"] == []
    assert told[0].startswith(name)
    assert result["source"] and result["title"]
    if isinstance(PROBLEMS[name], Motion):
        assert all(p["evaluations"] > 10 * p["steps"] / 4 > 0 for p in result["points"])
        assert result["operations"]["additions"] > 0
    else:
        assert all(row["error"] > 0 and row["seconds"]["udot"] > 0 for row in result["sizes"])


@pytest.mark.campaign
@pytest.mark.parametrize("name", list(PROBLEMS))
def test_a_problem_reaches_what_is_asked_of_it(name, tmp_path):
    """Errors and evaluations; times depend on the machine."""
    result = measure(PROBLEMS[name], tmp_path, False, lambda what: None, budget=0.05)
    assert result["failed"] == []


def test_the_machine_is_named():
    found = machine()
    assert found.keys() >= {"processor", "instructions", "compiler", "flags", "python", "ordernm"}
    assert all(found.values())
