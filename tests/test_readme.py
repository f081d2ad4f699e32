"""README.md and docs/api.md: their code runs, what they quote is printed, and they name the members that there are."""

import inspect
import re
from pathlib import Path

import numpy as np
import pytest

import codegen
from codegen.cli import generate_main, main
from codegen.runtime import Solver

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
API = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def here(tmp_path_factory):
    """A folder like the checkout, in which README's models lie."""
    place = tmp_path_factory.mktemp("readme")
    (place / "examples").symlink_to(ROOT / "examples")
    for text in re.findall(r"```yaml\n(.*?)```", README, re.DOTALL):
        (place / f"{re.findall('model: (.*)', text)[0]}.yaml").write_text(text)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        patch.setenv("ORDERNM_CFLAGS", "-O1")  # compiles quicker
        yield place


def python(word: str) -> dict:
    """Names after the piece of Python that contains a word."""
    (code,) = [c for c in re.findall(r"```python\n(.*?)```", README, re.DOTALL) if word in c]
    names: dict = {}
    exec(compile(code, "README.md", "exec"), names)
    return names


def test_the_first_example(here):
    names = python("mass_matrix_sensitivities")
    assert names["dudot"].shape == (6, 2) and names["dM"].shape == (6, 2, 2) and names["dvalues"].shape == (2, 6)
    np.testing.assert_allclose(names["dudot"], names["J"].p.T, rtol=1e-12, atol=1e-12)


def test_the_chain_loads(here):
    assert codegen.load_model("chain.yaml").nu == 12 and codegen.load_model("chain.yaml").warnings == ()


def test_the_crank_rocker(here, capsys):
    assert generate_main(["crank_rocker.yaml"]) == 0
    out = [line.strip() for line in capsys.readouterr().out.splitlines()]
    (quoted,) = re.findall(r"prints its choice of dependent speeds:\n\n```text\n(.*?)```", README, re.DOTALL)
    assert [line for line in quoted.splitlines() if line.strip() not in out] == []
    names = python("closure(q, u)")
    assert names["q"][0] == 1.2 and np.abs(names["position"]).max() < 1e-12
    assert names["dq"].shape == (1, 3) and names["dq"][0, 0] == 0 and np.abs(names["dq"][0, 1:]).min() > 0
    assert main(["check", "crank_rocker.yaml"]) == 0


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


def test_every_member_of_a_solver_is_told_and_exists(here):
    members = {name for name in vars(Solver) if not name.startswith("_")}
    words = set(re.findall(r"\w+", " ".join(re.findall(r"`([^`]*)`", API))))
    assert members - words == set()
    codegen.generate("crank_rocker.yaml", "generated/crank_rocker")
    solver = codegen.load("generated/crank_rocker")
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
