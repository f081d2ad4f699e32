"""The page on CasADi: its code runs and prints what the page shows."""

import importlib

import pytest
from doc_pages import ROOT, follow

pytest.importorskip("casadi", reason="CasADi is not installed: pip install -e '.[casadi]'")


def test_all_blocks_of_the_page_run(tmp_path):
    followed = follow("docs/howto/casadi.md", tmp_path)
    assert followed.names["best"].iterations < 40


def test_the_example_of_a_leg_finds_better_lengths(monkeypatch, capsys):
    monkeypatch.syspath_prepend(str(ROOT / "examples" / "casadi"))
    given, best = importlib.import_module("leg_step").main()
    assert best.value < 0.6 * given.value and "as given: 2.6531" in capsys.readouterr().out
