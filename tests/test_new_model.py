"""First models, the doctor and completion."""

import contextlib
import os
import pty
import re
import shutil
import subprocess
import tomllib
from pathlib import Path
from types import SimpleNamespace

import pytest

import ordernm
from codegen import cli
from codegen.doctor import EXTRAS
from codegen.runtime.standalone.errors import CompileError
from codegen.starters import starters, text_of


@pytest.mark.parametrize("starter", starters())
def test_starters_are_models_that_move(starter, tmp_path):
    model = ordernm.parse_model(text_of(starter, "first"))
    assert not model.warnings
    ordernm.generate(model, tmp_path / "first", target="numpy", check=False)
    solver = ordernm.load(tmp_path / "first", target="numpy")
    q, u = solver.initial
    found = solver.sensitivities(q, u, dp=[[1.0] * solver.np])
    assert all(abs(x).max() < 1e5 for x in found)


def test_new_writes_what_is_chosen(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["new", "--list"]) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == list(starters())
    assert cli.main(["new", "robot.yaml", "--from", "arm"]) == 0
    assert ordernm.load_model("robot.yaml").name == "robot"
    assert cli.main(["new", "robot.yaml"]) == 2
    assert "robot.yaml exists" in capsys.readouterr().err
    assert cli.main(["new"]) == 2
    assert "which file?" in capsys.readouterr().err


def test_the_doctor_says_what_is_missing(monkeypatch, capsys, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(
        "codegen.doctor.EXTRAS", {"plot": (("no_such_module",), "curves"), "other": (("json",), "nothing")}
    )
    asked, report = {}, SimpleNamespace(disagreeing={})
    monkeypatch.setattr("codegen.generation.generate", lambda *a, **named: asked.update(named) or report)
    assert cli.main(["doctor"]) == 0 and asked["check"]
    out = capsys.readouterr().out
    checkout = Path(ordernm.__file__).parents[1]
    assert (
        f'plot        curves: missing: pip install -e "{checkout}[plot]"' in out
        and "other       nothing: installed" in out
    )
    assert "a solver compiles, and agrees with the generic engine" in out

    report.disagreeing = {"udot": 0.1}
    assert cli.main(["doctor"]) == 3
    assert "its results differ from those of the generic engine: {'udot': 0.1}" in capsys.readouterr().out

    def broken(*given, **named):
        raise CompileError("cc: no such thing")

    monkeypatch.setattr("codegen.generation.generate", broken)
    assert cli.main(["doctor"]) == 3
    assert "a solver does not compile: cc: no such thing" in capsys.readouterr().out


def test_the_doctor_and_the_page_of_errors_know_the_extras_of_users():
    root = Path(ordernm.__file__).parents[1]
    extras = tomllib.loads((root / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    of_users = extras.keys() - {"test", "docs", "wasm"}  # of those who develop ordernm
    assert EXTRAS.keys() == of_users
    listed = re.search(r"Extras are ([^.]*)\.", (root / "docs/errors.md").read_text())
    assert {*re.findall(r"`(\w+)`", listed[1])} == of_users


@pytest.mark.parametrize("shell", ["bash", "zsh", "tcsh"])
def test_completion_knows_commands_and_options(shell, capsys):
    pytest.importorskip("shtab", reason="writes the scripts: pip install shtab")
    assert cli.main(["completion", shell]) == 0
    out = capsys.readouterr().out
    assert "simulate" in out and "no-browser" in out


def completed(typed, cwd):
    """A line of an interactive bash after a few keys and TAB, with the completion loaded."""
    ours, theirs = pty.openpty()
    environment = {**os.environ, "TERM": "dumb", "HISTFILE": ""}
    with subprocess.Popen(
        ["bash", "--norc", "--noprofile", "-i"], cwd=cwd, env=environment, stdin=theirs, stdout=theirs, stderr=theirs,
        start_new_session=True,
    ) as shell:  # fmt: skip
        os.close(theirs)
        found = b""
        os.write(ours, b"source ./script; echo $((6 * 7))ready\n")
        with contextlib.suppress(OSError):  # the shell has closed its end
            while b"42ready" not in found:
                found += os.read(ours, 4096)
            os.write(ours, f"{typed}\t\x01echo $((6 * 7)): \x05; exit\n".encode())
            while part := os.read(ours, 4096):
                found += part
        os.close(ours)
        shell.wait(10)
    return re.search(r"^42: (.*?)\r?$", found.decode(), re.MULTILINE)[1].strip()


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
@pytest.mark.parametrize(
    ("typed", "line"),
    [
        ("ordernm generate exa", "ordernm generate example.yaml"),
        ("ordernm generate example.yaml -o out", "ordernm generate example.yaml -o output_folder/"),
        ("ordernm simulate example.yaml -o run", "ordernm simulate example.yaml -o run.npz"),
        ("ordernm view --trajectory run", "ordernm view --trajectory run.npz"),
        ("ordernm gen", "ordernm generate"),
    ],
)
def test_bash_completes_files_and_folders(typed, line, tmp_path, capsys):
    pytest.importorskip("shtab", reason="writes the scripts: pip install shtab")
    assert cli.main(["completion", "bash"]) == 0
    (tmp_path / "script").write_text(capsys.readouterr().out)
    (tmp_path / "example.yaml").touch()
    (tmp_path / "run.npz").touch()
    (tmp_path / "output_folder").mkdir()
    assert completed(typed, tmp_path) == line


def test_files_of_starters_name_the_model(tmp_path):
    for starter in starters():
        text = text_of(starter, "swing")
        assert text.startswith("# swing: ") and "\nmodel: swing\n" in text and "NAME" not in text
