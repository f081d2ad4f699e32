"""README.md and docs/api.md: their code runs, quoted output is printed, and the named members exist."""

import inspect
import re
from pathlib import Path

import numpy as np
import pytest
from doc_pages import blocks, follow

from codegen.cli import main
from codegen.runtime import Solver

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
API = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def readme(tmp_path_factory):
    """README.md, after its code blocks have run."""
    return follow("README.md", tmp_path_factory.mktemp("readme"))


def test_the_first_example(readme):
    names, n = readme.names, readme.names["solver"].nu
    assert names["dudot"].shape == (names["solver"].np, n) and names["dM"].shape == (names["solver"].np, 1, 1)
    np.testing.assert_allclose(names["dudot"], names["J"].p.T, rtol=1e-12, atol=1e-12)
    assert names["run"].dq.shape[0] == names["solver"].np and names["run"].closure_drift < 1e-12
    assert 12 <= len(blocks("README.md", "python")[0].splitlines()) <= 17


def test_commands_that_are_named_exist(capsys):
    for command in (
        "generate",
        "simulate",
        "view",
        "new",
        "doctor",
        "completion",
        "import",
        "report",
        "bench",
        "equations",
        "statements",
        "export",
    ):
        with pytest.raises(SystemExit):
            main([command, "--help"])
    options = set(re.findall(r"\B--[a-z][a-z-]+", capsys.readouterr().out))
    pages = [ROOT / "docs" / "tutorial.md", ROOT / "docs" / "trust.md", *(ROOT / "docs" / "howto").glob("*.md")]
    for page in (README, API, *(page.read_text(encoding="utf-8") for page in pages)):
        for command in re.findall(
            r"ordernm (new|doctor|completion|check|show|generate|simulate|view|import|report|bench|equations|statements)\b",
            page,
        ):
            with pytest.raises(SystemExit) as end:
                main([command, "--help"])
            assert end.value.code == 0
        ours = "\n".join(line for line in page.splitlines() if "pytest" not in line)
        assert set(re.findall(r"\B--[a-z][a-z-]+", ours)) - options == set()


def test_every_member_of_a_solver_is_told_and_exists(readme):
    members = {name for name in vars(Solver) if not name.startswith("_")}
    words = set(re.findall(r"\w+", " ".join(re.findall(r"`([^`]*)`", API))))
    assert members - words == set()
    solver = readme.names["solver"]
    table = API[API.index("## Members of a solver") : API.index("## Closed loops")]
    rows = re.findall(r"^\| (`[^|]*) \|", table, re.MULTILINE)
    named = re.findall(r"\w+", re.sub(r"\([^)]*\)|->.*", "", " ".join(rows)))
    assert len(named) > 30 and [name for name in named if not hasattr(Solver, name) and not hasattr(solver, name)] == []


def test_signatures_are_those_of_the_solver():
    found = 0
    for name, arguments in re.findall(r"`(\w+)\(([^)`]*)\)`", API):
        if not hasattr(Solver, name):
            continue
        parameters = [n for n in inspect.signature(getattr(Solver, name)).parameters if n != "self"]
        positional, _, keywords = arguments.partition("*")
        given = [a.partition("=")[0].strip() for a in positional.split(",") if a.strip() not in ("", "...")]
        assert given == parameters[: len(given)], name  # what is left out may follow
        assert {a.partition("=")[0].strip() for a in keywords.split(",")} - {"", "..."} <= set(parameters), name
        found += 1
    assert found > 8
