"""Robots in ordernm and Pinocchio: all results agree, and robots whose files cannot be read are listed."""

import json

import pytest

from codegen.bench import lines, page
from codegen.bench.catalogue import ROBOTS
from codegen.bench.measuring import measure
from codegen.bench.plots import plots, write_plots
from codegen.bench.results import figures
from codegen.measure import pinocchio_models

MACHINE = dict.fromkeys(("processor", "instructions", "compiler", "flags", "system", "python", "numpy", "ordernm"), "x")


def test_matrices_and_batches_agree_with_pinocchio(tmp_path, monkeypatch):
    pytest.importorskip("pinocchio")
    monkeypatch.setenv("ORDERNM_CFLAGS", "-O0")
    found = measure(ROBOTS, tmp_path, True, lambda text: None, 0.01)
    assert found == json.loads(json.dumps(found)) and not found["failed"] and not found["skipped"]
    (row,) = found["rows"]
    assert row["model"] == "CHAIN(7)" and row["speeds"] == 7 and 0 < row["error"] < 1e-12
    assert list(row["seconds"]) == list(row["theirs"]) == ["udot", "Jacobians", "M", "M^-1", "udot of a batch"]
    results = {"machine": MACHINE, "quick": True, "problems": {"robots": found}}
    assert len(list(figures(results))) == 5
    printed = lines.problem_lines("robots", found, None)
    assert any("CHAIN(7)" in line for line in printed)
    text = page.page_of(results)
    assert "## Robots beside Pinocchio" in text and "| CHAIN(7) | 7 |" in text
    found["rows"][0]["error"] = 1e-3
    found["failed"] = ["CHAIN(7)"]
    assert lines.robot_lines(found, None)[-1] == "  failed: difference above 1e-09 of CHAIN(7)"


def test_robots_that_are_not_there_are_named(tmp_path, monkeypatch):
    monkeypatch.setattr(pinocchio_models, "robots_folder", lambda: tmp_path)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: object())
    alone = type(ROBOTS)(**{**vars(ROBOTS), "models": ("UR5",)})
    found = measure(alone, tmp_path, False, lambda text: None, 0.01)
    assert found["skipped"]["UR5"].endswith("is not there (pip install example-robot-data)") and not found["rows"]
    assert lines.robot_lines(found, None)[0].startswith("  UR5: not measured, ur_description/")
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    found = measure(alone, tmp_path, False, lambda text: None, 0.01)
    assert found["skipped"] == {"UR5": "pinocchio is not installed (pip install ordernm[peers])"}
    assert "## Robots" not in page.page_of({"machine": MACHINE, "quick": True, "problems": {"robots": found}})


def test_pictures_have_families_with_their_exponents_and_robots(tmp_path):
    pytest.importorskip("matplotlib")
    sizes = [{"bodies": n, "seconds": {"udot": 1e-8 * n, "udot + 8": 2e-8 * n * n}} for n in (10, 100, 1000)]
    row = {"model": "UR5", "speeds": 6, "seconds": {"udot": 1e-6, "M": 2e-6}, "theirs": {"udot": 2e-6, "M": 2e-6}}
    problems = {"chain": {"kind": "family", "sizes": sizes}, "robots": {"kind": "robots", "rows": [row]}}
    drawn = plots({"problems": problems})
    assert list(drawn) == ["time_by_size", "robots"]
    texts = list(drawn.values())
    assert "chain, exponent 1.00" in texts[0] and "chain, exponent 2.00" in texts[0] and "UR5, 6" in texts[1]
    assert drawn == plots({"problems": problems}) and plots({"problems": {}}) == {}
    write_plots(drawn, tmp_path / "new")
    assert [(tmp_path / "new" / f"{name}.svg").read_text() for name in drawn] == texts


def test_a_roofline_has_every_family_under_what_the_core_can_do():
    pytest.importorskip("matplotlib")
    rows = [
        {"bodies": n, "seconds": {"udot": 1e-8 * n, "udot + 8": 2e-8 * n},
         "roofline": [{"name": name, "operations": n, "per_second": 2e9, "per_byte": 3.0} for name in ("udot", "udot + 8")]}
        for n in (10, 100)
    ]  # fmt: skip
    problems = {name: {"kind": "family", "sizes": rows} for name in ("chain", "ladder")}
    peaks = {"vectors": 1e11, "numbers": 8e9, "first cache": 4e11, "memory": 2e10}
    drawn = plots({"problems": problems, "peaks": peaks})
    assert list(drawn) == ["time_by_size", "roofline"]
    text = drawn["roofline"]
    for label in ("chain, udot", "ladder, udot + 8", "memory, 20 GB/s", "one number at a time, 8.0 GFlop/s"):
        assert f">{label}<" in text, label
