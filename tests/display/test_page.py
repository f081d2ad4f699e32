"""docs/views.md: its Python runs, and its commands exist."""

import re
import shutil
from pathlib import Path

import pytest

from codegen import cli

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "views.md").read_text(encoding="utf-8")


def test_its_python_runs(tmp_path, monkeypatch):
    pytest.importorskip("PIL", reason="writes animations: pip install pillow")
    shutil.copytree(ROOT / "examples", tmp_path / "examples", ignore=shutil.ignore_patterns("figures"))
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    assert blocks
    for block in blocks:
        exec(compile(block, "views.md", "exec"), {})
    assert Path("four_bar.svg").stat().st_size > 1000 and Path("four_bar.gif").stat().st_size > 1000


def test_its_commands_exist():
    commands = re.findall(r"ordernm (view [^\n#`]*)", PAGE)
    assert len(commands) >= 4
    for command in commands:
        words = [word for word in command.replace("\n", " ").split() if word]
        if len(words) > 1 and words[1][0] not in "ksi":  # a command, and not a sentence about it
            cli.parser_of_commands("view").parse_args(words)
