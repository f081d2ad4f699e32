"""docs/views.md: its Python runs, and its commands are those that there are."""

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


def test_the_site_has_every_page_and_each_has_a_title():
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    listed = set(re.findall(r"^([a-z_]+)$", index, re.MULTILINE))
    pages = {p.stem for p in (ROOT / "docs").glob("*.md")} - {"index"}
    assert pages <= listed
    assert all((ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8").startswith("# ") for name in pages)


def test_internal_links_lead_somewhere():
    """Links between pages of the documentation, with their anchors."""

    def anchors(path):
        titles = re.findall(r"^#+ (.+)$", path.read_text(encoding="utf-8"), re.MULTILINE)
        return {re.sub(r"[^\w\- ]", "", re.sub(r"[`*]", "", t).lower()).replace(" ", "-") for t in titles}

    wrong = []
    for page in (ROOT / "docs").rglob("*.md"):
        for target, anchor in re.findall(r"\]\((?!https?:)([^)#\s]*)#?([^)\s]*)\)", page.read_text(encoding="utf-8")):
            path = (page.parent / target) if target else page
            if not path.exists() or (anchor and path.suffix == ".md" and anchor not in anchors(path)):
                wrong.append(f"{page.name}: {target}#{anchor}")
    assert wrong == []
