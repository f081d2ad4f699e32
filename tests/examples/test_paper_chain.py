"""examples/paper_chain.py in its small mode: all contestants agree (the script checks it), and it writes tables and a plot."""

import csv
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "examples" / "paper_chain.py"


@pytest.mark.skipif(shutil.which("gcc") is None, reason="the contestants are compiled with gcc")
def test_the_small_mode_compares_all_contestants_and_writes_its_tables(tmp_path):
    command = [sys.executable, SCRIPT, "--small", "--folder", tmp_path / "figures", "--cache", tmp_path / "cache"]
    run = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    with (tmp_path / "figures" / "paper_chain.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["n"] for row in rows] == ["1", "2", "4"]
    assert all(float(row["ordernm, us"]) > 0 and float(row["largest difference"]) < 1e-10 for row in rows)
    assert rows[1]["closed form, us"], "two rods in closed form take sympy a second or two"
    with (tmp_path / "figures" / "paper_chain_parameters.csv").open() as file:
        assert [row["parameters"] for row in csv.DictReader(file)] == ["1", "2", "3", "9"]
    assert (tmp_path / "figures" / "paper_chain.png").exists() or "matplotlib is not installed" in run.stdout
