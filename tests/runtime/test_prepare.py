"""Libraries that are compiled on request, the display in a terminal meanwhile, and the measured time of a motion."""

import sys
import time
from pathlib import Path

import pytest

import codegen
from codegen.runtime.standalone.files import build, compiling

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture
def fresh(tmp_path, monkeypatch):
    """A package with only its first library compiled, and a list of the parts compiled later."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    codegen.generate(codegen.load_model(EXAMPLES / "four_bar.yaml"), tmp_path / "four_bar", check=False)
    solver = codegen.load(tmp_path / "four_bar")
    compiled = []
    compile_ = build.Build._compile

    def noting(self, *given):
        compiled.append(self.part or self.name)
        compile_(self, *given)

    monkeypatch.setattr(build.Build, "_compile", noting)
    return solver, compiled


def test_what_members_need_is_compiled_once(fresh):
    solver, compiled = fresh
    solver.prepare("jacobians")
    assert len(compiled) >= 1
    before = list(compiled)
    solver.jacobians(*solver.initial)
    solver.prepare("jacobians")
    assert compiled == before
    solver.prepare("simulate")
    before = list(compiled)
    run = solver.simulate(0.1)
    assert compiled == before and "compiling" not in run.stats
    solver.prepare()
    before = list(compiled)
    for name in ("energies", "mass_matrix", "outputs", "gradients"):
        if name != "gradients":
            getattr(solver, name)(*solver.initial[: 1 if name == "mass_matrix" else 2])
    assert compiled == before


def test_unknown_members_are_refused(fresh):
    with pytest.raises(
        ValueError, match=r"prepare: 'simulat' is not a method that is compiled; expected one of accelerations, "
    ):
        fresh[0].prepare("simulat")
    with pytest.raises(AttributeError, match="has no prescribed motion"):
        fresh[0].prepare("driving_forces")


def test_a_motion_does_not_count_what_it_waits_for(fresh):
    solver, _ = fresh
    began = time.perf_counter()
    run = solver.simulate(0.1)
    whole = time.perf_counter() - began
    assert run.stats["compiling"] > 0.0
    assert run.stats["seconds"] + run.stats["compiling"] <= whole
    assert "compiling" not in solver.simulate(0.1).stats


@pytest.mark.parametrize(
    ("terminal", "progress", "watched"), [(True, "", True), (False, "", False), (True, "off", False)]
)
def test_who_looks_is_told_what_takes_time(monkeypatch, capsys, terminal, progress, watched):
    monkeypatch.setenv("ORDERNM_PROGRESS", progress)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("CI", raising=False)
    monkeypatch.setattr(compiling, "PATIENCE", 0.01)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal, raising=False)
    with compiling.waiting("arm (motion)"):
        time.sleep(0.2)
    with compiling.waiting("quick"):
        pass
    assert capsys.readouterr().err == (
        "compiling arm (motion); the library is kept for later calls\n" if watched else ""
    )


def test_members_that_can_be_prepared_are_those_that_can_be_called(tmp_path):
    """Every member of a list in an error is a method, and one that is made of other functions has these compiled."""
    model = codegen.load_model(EXAMPLES / "four_bar.yaml")
    codegen.generate(model, tmp_path / "all", check=False, compile=False, frames=True)
    codegen.generate(model, tmp_path / "few", check=False, compile=False, functions=("accelerations", "energies"))
    for folder in ("all", "few"):
        solver = codegen.load(tmp_path / folder, "numpy")
        with pytest.raises(ValueError, match="prepare: 'nothing' is not a method ") as error:
            solver.prepare("nothing")
        names = str(error.value).partition("expected one of ")[2].split(", ")
        assert names[-1] == "batches" and all(callable(getattr(solver, n)) for n in names[:-1])
        solver.prepare(*names)
        assert {"assemble", "initial_state"} <= {*names}  # without closing_step too, which motions alone need
        assert {"points", "mass_matrix", "gradients"} <= {*names} or folder == "few"
        assert {"points", "mass_matrix", "gradients", "equilibrium"}.isdisjoint(names) or folder == "all"
    with pytest.raises(ValueError, match="'closing_step' is not a method"):
        solver.prepare("closing_step")
    for lacking in ("points", "jacobians", "equilibrium"):
        with pytest.raises(AttributeError, match="generate it with"):
            solver.prepare(lacking)
