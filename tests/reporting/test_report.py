"""Reports: numbers equal the solver's, pages need no other files, and omissions are listed."""

import json
import re
from pathlib import Path

import mpmath
import numpy as np
import pytest

import codegen
from codegen.cli import main
from codegen.reference import DenseEngine
from codegen.reporting import Request, processes, report
from codegen.reporting.errors import relative
from codegen.reporting.pages import tables
from codegen.reporting.skipped import seconds_in_words

pytest.importorskip("matplotlib", reason="reports draw figures; the extra plot installs matplotlib")

EXAMPLES = Path(__file__).parents[2] / "examples"
QUICK = Request(end=0.5, timing=0.01, reference=300.0)  # no state is left out, however slow the machine


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A report of the four-bar, its folder, and the function's result; two processes measure its times."""
    folder = tmp_path_factory.mktemp("report") / "four_bar"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(processes, "PROCESSES", 2)
        return folder, report(EXAMPLES / "four_bar.yaml", folder, request=QUICK)


@pytest.fixture(scope="module")
def numbers(written):
    return json.loads((written[0] / "report.json").read_text())


@pytest.fixture(scope="module")
def solver(tmp_path_factory):
    folder = tmp_path_factory.mktemp("solver") / "four_bar"
    codegen.generate(EXAMPLES / "four_bar.yaml", folder, target="numpy")
    return codegen.load(folder)


def test_counts_are_the_solvers(numbers, solver):
    model = codegen.load_model(EXAMPLES / "four_bar.yaml")
    found = numbers["generated"]
    assert (found["bodies"], found["loops"], found["freedoms"]) == (
        len(model.bodies),
        1,
        len(solver.independent_speed_names),
    )
    assert (found["coordinates"], found["speeds"], found["parameters"]) == (solver.nq, solver.nu, solver.np)
    assert found["operations"] == solver.operations


def test_errors_are_those_of_the_dense_engine_too(numbers, solver):
    """The report compares with the recursive engine; the dense method in 40 digits finds the same errors."""
    model = codegen.load_model(EXAMPLES / "four_bar.yaml")
    states = {s["name"]: s for s in numbers["states"]}
    assert {"random 1", "fast", "worst condition"} <= {e["state"] for e in numbers["errors"]}
    for record in numbers["errors"]:
        assert 0 <= record["udot"] < 1e-12
        assert all(e < 1e-11 for e in record["derivatives"].values())
        assert set(model.parameter_names) <= set(record["derivatives"])
        estimates = [record["estimate"], *record["estimates"].values()]
        assert len(estimates) == 1 + len(record["derivatives"]) and all(0 < e < 1e-10 for e in estimates)
    state = states["random 1"]
    at = [np.array(state[n]) for n in ("q", "u")]
    i = model.parameter_names.index("coupler_length")
    seed = np.eye(solver.np)[i : i + 1]
    udot, dudot = solver.sensitivities(*at, None, state["inputs"], state["t"], dp=seed)
    with mpmath.workdps(40):
        exact, dexact = DenseEngine(model, numbers="mpmath").sensitivities(
            *at, None, state["inputs"], state["t"], dp=seed
        )
        here = relative(udot, exact), relative(dudot[0], dexact[0])
    # C and NumPy round differently: the same size is what can be asked for
    assert here[0] < 1e-13 and here[1] < 1e-12
    assert states["worst condition"]["condition"] >= states["random 1"]["condition"]


def test_the_first_state_has_jacobians_and_a_gradient(numbers):
    first = numbers["errors"][0]
    assert first["state"] == "random 1"
    assert 0 < first["jacobians"] < 1e-11 and 0 < first["gradient"] < 1e-11


def test_finite_differences_make_a_v_and_never_reach_the_exact_derivative(numbers):
    found = numbers["differences"]
    central = [e for e in found["central"] if e is not None]
    best = min(central)
    assert found["exact"] < 1e-12 < best
    assert central[0] > 1e3 * best and central[-1] > 1e3 * best


def test_motions_get_better_with_the_tolerance(numbers):
    found = numbers["motions"]
    assert found["end"] == 0.5 and "ended" not in found
    for method, points in found["methods"].items():
        errors = [p["error"] for p in points]
        assert len(points) > 3 and errors[-1] < 1e-3 * errors[0], method
        assert all(p["seconds"] > 0 and p["evaluations"] > 0 for p in points)
        settings = [p["setting"] for p in points]
        assert settings == sorted(settings, reverse=True)
    assert found["methods"]["dop853"][-1]["error"] < 1e-9
    assert min(found["conditions"]["closures"]) >= 1


def test_times_are_in_order(numbers):
    for record in numbers["times"]["functions"].values():
        for kind in ("compiled", "call"):
            assert 0 < record[kind]["least"] <= record[kind]["median"] <= record[kind]["high"]
    points = numbers["roofline"]["points"]
    for point, name in zip(points, ("udot", "udot + 1 direction", "udot + 8 directions"), strict=True):
        assert point["name"] == name
        least = numbers["times"]["functions"][name]["compiled"]["least"]
        assert point["per_second"] == pytest.approx(point["operations"] / least)


@pytest.mark.parametrize("name", [None, "udot + 1 direction"])
def test_a_function_above_the_peak_is_a_remark(numbers, name):
    """Other work disturbs a core while it measures the peak, and the page says so."""
    points = [p | {"per_second": 1e9 + (p["name"] == name)} for p in numbers["roofline"]["points"]]
    roofline = numbers["roofline"] | {"points": points, "peaks": numbers["roofline"]["peaks"] | {"vectors": 1e9}}
    found = [s for s in tables(numbers | {"roofline": roofline}) if s.title == "Roofline"]
    remarks = [text for text in found[0].text if "faster than the peak" in text]
    assert len(remarks) == (name is not None) and all(name in text for text in remarks)


def test_the_page_needs_nothing_else(written):
    folder, data = written
    page = (folder / "index.html").read_text()
    assert page.count("<svg") == len(list((folder / "figures").glob("*.svg"))) == 6
    assert not re.search(r'(src|href)="(?!#)', page.replace('xlink:href="#', "").replace('href="#', ""))
    assert "@import" not in page and "<script" not in page
    text = (folder / "report.md").read_text()
    assert all(f"figures/{p.name}" in text for p in (folder / "figures").glob("*.svg"))
    assert data["model"] == "four_bar" and f"<title>{data['model']}" in page


def test_a_model_too_large_for_the_reference_says_what_was_left_out(tmp_path, monkeypatch):
    monkeypatch.setattr(processes, "PROCESSES", 2)
    data = report(EXAMPLES / "pendulum.yaml", tmp_path / "r", request=Request(end=0.1, timing=0.002, reference=1e-9))
    left_out = {s["what"]: s for s in data["skipped"]}
    record = left_out["errors against the generic engine in extended precision"]
    assert "too large" in record["why"] and record["seconds"] > 1e-9
    assert "errors" not in data or not data["errors"]
    assert "would have taken" in (tmp_path / "r" / "index.html").read_text()
    assert data["differences"]["exact"] is None


def test_other_peoples_folders_stay(tmp_path, capsys):
    mine = tmp_path / "mine"
    mine.mkdir()
    (mine / "thesis.txt").write_text("years of work")
    assert main(["report", str(EXAMPLES / "pendulum.yaml"), "-o", str(mine)]) == 2
    assert "thesis.txt" in capsys.readouterr().err and (mine / "thesis.txt").exists()
    assert main(["report", str(tmp_path / "none.yaml"), "-o", str(tmp_path / "r")]) in (1, 2)
    assert not (tmp_path / "r").exists()
    assert main(["report", str(EXAMPLES / "pendulum.yaml"), "-t", "0", "-o", str(tmp_path / "r")]) == 2
    assert main(["report", str(mine), "-o", str(tmp_path / "r")]) == 2
    assert "no model files" in capsys.readouterr().err


def test_gallery(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("codegen.reporting.motions.END", 0.1)
    monkeypatch.setattr(processes, "PROCESSES", 2)
    models = tmp_path / "models"
    models.mkdir()
    (models / "swing.yaml").write_text((EXAMPLES / "pendulum.yaml").read_text())
    (models / "wrong.yaml").write_text("model: wrong\nbodies: {}\n")
    assert main(["report", str(models), "-t", "0.1", "-o", str(tmp_path / "gallery")]) == 1
    assert "wrong" in capsys.readouterr().err
    page = (tmp_path / "gallery" / "index.html").read_text()
    assert 'href="swing/index.html"' in page and "No report of wrong" in page
    assert (tmp_path / "gallery" / "swing" / "index.html").exists()


@pytest.mark.parametrize(("seconds", "words"), [(0.004, "4 ms"), (40.0, "40 s"), (300.0, "5 min"), (7.2e4, "20 h")])
def test_seconds_in_words(seconds, words):
    assert seconds_in_words(seconds) == words
