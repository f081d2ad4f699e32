"""The gallery's scripts run in their short form, with the checks that they contain; the campaign runs them in full."""

import re
import runpy
from pathlib import Path

import numpy as np
import pytest
from random_models import relative_error

import codegen
from codegen.reference import DenseEngine

GALLERY = Path(__file__).parents[2] / "examples" / "gallery"
SCRIPTS = sorted(GALLERY.glob("plot_*.py"))
MODELS = sorted(p for p in GALLERY.glob("*.yaml") if p.stem != "cam")  # whose script compares it with SciPy's spline


@pytest.fixture
def run(monkeypatch, tmp_path):
    """Run a script, with its packages in a folder of the test."""
    matplotlib = pytest.importorskip("matplotlib")
    monkeypatch.syspath_prepend(str(GALLERY))
    monkeypatch.setenv("MPLBACKEND", "agg")
    import matplotlib.pyplot as plt
    import stage

    monkeypatch.setattr(stage, "GENERATED", tmp_path)
    monkeypatch.setattr(stage, "ANIMATIONS", tmp_path)

    def whole(script, short):
        monkeypatch.setattr(stage, "SHORT", short)
        with matplotlib.rc_context(), plt.ioff():
            plt.close("all")
            found = runpy.run_path(str(script))
            assert plt.get_fignums(), "a result is drawn"
            for number in plt.get_fignums():
                plt.figure(number).savefig(tmp_path / f"{number}.png")
            plt.close("all")
        return found

    return whole


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda p: p.stem)
def test_a_script_runs_in_its_short_form(run, script):
    run(script, True)


@pytest.mark.campaign
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda p: p.stem)
def test_a_script_runs_whole_and_its_animation_is_small(run, script, tmp_path):
    run(script, False)
    assert all(film.stat().st_size < 300_000 for film in tmp_path.glob("*.gif"))


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda p: p.stem)
def test_a_script_says_problem_model_source_and_result_and_checks_its_numbers(script):
    text = script.read_text(encoding="utf-8")
    for part in (r"\*\*Problem\.\*\*", r"\*\*Model\.\*\*", r"\*\*Sources?\.\*\*", r"\*\*Result\.\*\*", "assert"):
        assert re.search(part, text), part
    code = [line for line in text.partition('\n"""\n')[2].splitlines() if line and not line.startswith("#")]
    assert 25 <= len(code) <= 90


@pytest.mark.parametrize("path", MODELS, ids=lambda p: p.stem)
def test_a_model_of_the_gallery_agrees_with_a_reference_engine(path, tmp_path):
    model = codegen.load_model(path)
    assert model.warnings == () and model.name == path.stem
    codegen.generate(model, tmp_path / "x", functions=("output_sensitivities",), compile="all")
    solver, engine = codegen.load(tmp_path / "x"), DenseEngine(model)
    q, u = solver.initial
    dp = np.random.default_rng(1).normal(size=(2, solver.np))
    found, expected = (e.output_sensitivities(q, u, t=0.0, dp=dp) for e in (solver, engine))
    for one, other in zip(found, expected, strict=True):
        assert relative_error(one, other) < 1e-9
