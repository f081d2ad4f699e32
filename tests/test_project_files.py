"""Files of the project agree with the code: version, citation, changelog, workflows, hooks."""

import re
import tomllib
from pathlib import Path

import pytest
import yaml

from codegen.version import __version__

ROOT = Path(__file__).parents[1]
CHANGELOG = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
YAML_FILES = [
    *sorted((ROOT / ".github").rglob("*.yml")),
    ROOT / ".pre-commit-config.yaml",
    ROOT / "CITATION.cff",
]
COMMANDS = "ruff check", "ruff format", "mypy codegen"


def read(path: Path) -> dict:
    return yaml.safe_load(path.read_text(encoding="utf-8"))


@pytest.mark.parametrize("path", YAML_FILES, ids=lambda p: p.name)
def test_yaml_is_read(path):
    assert isinstance(read(path), dict)


def test_the_version_is_the_same_everywhere():
    assert read(ROOT / "CITATION.cff")["version"] == __version__
    newest = re.search(r"^## \[(?:Unreleased\]: )?([\d.]+)", CHANGELOG, re.MULTILINE)
    assert newest and newest[1] == __version__


def test_the_citation_is_of_this_project():
    citation = read(ROOT / "CITATION.cff")
    project = PROJECT["project"]
    assert (citation["title"], citation["license"]) == (project["name"], project["license"])
    assert [a["name"] for a in citation["authors"]] == [a["name"] for a in project["authors"]]
    assert set(citation["keywords"]) == set(project["keywords"])


def test_lines_of_the_changelog_are_short():
    assert [line for line in CHANGELOG.splitlines() if len(line) > 100] == []


def test_pythons_of_the_workflow_begin_with_the_oldest_supported():
    jobs = read(ROOT / ".github" / "workflows" / "tests.yml")["jobs"]
    matrix = jobs["quick"]["strategy"]["matrix"]
    assert matrix == {"os": ["ubuntu-latest", "macos-latest"], "python": ["3.11", "3.12", "3.13", "3.14"]}
    assert PROJECT["project"]["requires-python"] == f">={matrix['python'][0]}"


def test_linters_are_the_same_in_workflow_hooks_and_script():
    steps = read(ROOT / ".github" / "workflows" / "tests.yml")["jobs"]["linters"]["steps"]
    texts = {
        "workflow": "\n".join(step.get("run", "") for step in steps),
        "hooks": "\n".join(h["entry"] for r in read(ROOT / ".pre-commit-config.yaml")["repos"] for h in r["hooks"]),
        "script": (ROOT / ".ci" / "run").read_text(encoding="utf-8"),
        "contributing": (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"),
    }
    assert [(n, c) for n, text in texts.items() for c in COMMANDS if c not in text] == []


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda p: p.name)
def test_files_that_a_workflow_runs_exist(path):
    runs = " ".join(s.get("run", "") for job in read(path)["jobs"].values() for s in job["steps"])
    files = [w for w in runs.split() if w.startswith(("tests/", ".ci/", "benchmarks/"))]
    assert files and [f for f in files if not (ROOT / f).exists()] == []
