"""examples/paper_loops.py in its small mode: the constrained methods agree (it checks that), and it writes tables and a plot."""

import csv
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "examples" / "paper_loops.py"


@pytest.mark.skipif(shutil.which("gcc") is None, reason="the contestants are compiled with gcc")
def test_the_small_mode_compares_the_methods_and_writes_its_tables(tmp_path):
    command = [sys.executable, SCRIPT, "--small", "--folder", tmp_path / "figures", "--cache", tmp_path / "cache"]
    run = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    rows = {}
    for name in ("chain", "ladder"):
        with (tmp_path / "figures" / f"paper_loops_{name}.csv").open() as file:
            rows[name] = list(csv.DictReader(file))
    assert [(row["n"], row["m"]) for row in rows["chain"]] == [("8", "5")]
    assert [(row["n"], row["m"]) for row in rows["ladder"]] == [("6", "4"), ("10", "8"), ("14", "12")]
    for row in rows["chain"] + rows["ladder"]:
        assert float(row["largest difference"]) < 1e-10
        assert all(float(x) > 0 for x in row.values())
    operations = [
        [float(row[f"{method} forward, operations"]) for row in rows["ladder"]]
        for method in ("embedded", "multipliers")
    ]
    first, second = (operations[0][k + 1] - operations[0][k] for k in (0, 1))
    # sweeps of small models are merged into one function, in which a few operations of the ends are simplified away
    assert 0.995 * first <= second <= first, "linear in the number of loops"
    assert operations[1][2] - operations[1][1] > operations[1][1] - operations[1][0], "and this is not"
    assert (tmp_path / "figures" / "paper_loops.png").exists() or "matplotlib is not installed" in run.stdout
