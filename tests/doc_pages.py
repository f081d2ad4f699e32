"""Runs the code blocks of a page of the documentation, one after the other, in a folder of its own.

- ``yaml`` and ``xml`` with a model or robot become ``NAME.yaml`` and ``NAME.urdf``; files in other languages begin with a comment
  that has their name.
- ``python`` is executed in one namespace. A ``text`` block after it is what it prints; ``...`` stands for any text.
- ``bash`` has commands that succeed, ``console`` commands after ``$`` with what they print, whatever their exit code.
- A picture of the page in ``docs/pictures`` has to be written by the page. ``ORDERNM_UPDATE_PICTURES=1`` copies it there.
"""

from __future__ import annotations

import contextlib
import doctest
import io
import os
import re
import shlex
import shutil
import subprocess
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from codegen import cli

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
BLOCK = re.compile(r"^```([a-z]+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
INSTALLING = ("python", "pip", "npm", "git", "cd")
LONG = ("report", "bench")
"""Commands whose arguments are only parsed."""


@dataclass
class Followed:
    """A page whose code blocks were run.

    Attributes
    ----------
    place : Path
        Where its files are.
    after : list of (code, names)
        Each block of Python, and what names meant after it.
    """

    place: Path
    names: dict[str, Any] = field(default_factory=dict)
    after: list[tuple[str, dict[str, Any]]] = field(default_factory=list)

    def piece(self, word: str) -> dict[str, Any]:
        """The values of all names after the only Python block that contains a word."""
        (found,) = [names for code, names in self.after if word in code]
        return found


def text_of(page: str) -> str:
    return (ROOT / page).read_text(encoding="utf-8")


def blocks(page: str, *languages: str) -> list[str]:
    return [text for language, text in BLOCK.findall(text_of(page)) if language in languages]


def follow(page: str, place: Path) -> Followed:
    """Run all code blocks of a page."""
    done = Followed(place)
    shutil.copytree(ROOT / "examples", place / "examples", ignore=shutil.ignore_patterns("figures", "gallery"))
    if page != "docs/tutorial.md":
        for text in blocks("docs/tutorial.md", "yaml", "xml"):
            write(text, place)
    printed = ""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        patch.syspath_prepend(place)  # for modules of the page
        for language, text in BLOCK.findall(text_of(page)):
            if language == "text":
                assert_prints(printed, text, page)
            printed = run(language, text, page, done) if language != "text" else ""
    check_pictures(page, place)
    return done


def run(language: str, text: str, page: str, done: Followed) -> str:
    """Run a block; returns the text that it prints."""
    if language == "python":
        with contextlib.redirect_stdout(io.StringIO()) as out:
            exec(compile(text, page, "exec"), done.names)
        done.after.append((text, dict(done.names)))
        return out.getvalue()
    if language == "bash":
        lines = [part for line in text.replace("\\\n", " ").splitlines() for part in line.split("&&")]
        return "".join(command(line, succeeds=True) for line in lines)
    if language == "console":
        for line, expected in re.findall(r"^\$ (.*)\n((?:(?!\$ ).*\n)*)", text, re.MULTILINE):
            assert_prints(command(line, succeeds=False), expected, page)
        return ""
    write(text, done.place)
    return ""


def write(text: str, place: Path) -> None:
    """Write a block that is a file."""
    first = text.partition("\n")[0]
    if named := re.match(r"(?:#|//|/\*|<!--) *([\w/.-]+\.\w+)\b", first):
        name = named[1]
        if name.endswith(".csv"):  # which has no comments
            text = text.partition("\n")[2]
    elif model := re.search(r"^model: (\w+)", text, re.MULTILINE):
        name = f"{model[1]}.yaml"
    elif robot := re.search(r'<robot name="(\w+)"', text):
        name = f"{robot[1]}.urdf"
    else:
        raise AssertionError(f"a block that is neither run nor a file: {first}")
    (place / name).parent.mkdir(parents=True, exist_ok=True)
    (place / name).write_text(text, encoding="utf-8")


def command(line: str, succeeds: bool) -> str:
    """Run a command of a page in this process; returns the text that it prints on both streams."""
    words = shlex.split(line, comments=True)
    if not words or words[0] in INSTALLING:
        return ""
    out = io.StringIO()
    if words[0] in ("generate", "ordernm"):
        if words[0] == "ordernm" and (words[1] in LONG or opens_browser(words)):
            cli.parser_of_commands(words[1]).parse_args(words[1:])
            return ""
        entry = cli.generate_main if words[0] == "generate" else cli.main
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
            code = entry(words[1:])
    else:
        assert words[0] in ("cc", "python3") or words[0].startswith("./"), f"unknown command: {line}"
        if words[0] == "cc":
            words[1:1] = ["-Wall", "-Wextra", "-Werror"]
            words[0] = shutil.which("cc") or pytest.skip("no C compiler")
        done = subprocess.run(words, capture_output=True, text=True)
        code = done.returncode
        out.write(done.stdout + done.stderr)
    assert not succeeds or code == 0, f"{line}\n{out.getvalue()}"
    return out.getvalue()


def opens_browser(words: list[str]) -> bool:
    return words[1] == "view" and not {"--html", "--picture", "--animate"} & set(words)


def assert_prints(printed: str, expected: str, page: str) -> None:
    flags = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    assert doctest.OutputChecker().check_output(expected, printed, flags), (
        f"{page} expects\n{expected}\nfound\n{printed}"
    )


def check_pictures(page: str, place: Path) -> None:
    """Every picture that the page's code writes is in docs/pictures."""
    for name in re.findall(r"!\[[^]]*\]\([^)]*\bpictures/([\w.-]+)\)", text_of(page)):
        if (place / name).exists():
            if os.environ.get("ORDERNM_UPDATE_PICTURES"):
                shutil.copy(place / name, DOCS / "pictures" / name)
            assert (DOCS / "pictures" / name).stat().st_size < 100_000, f"{page}: {name} is larger than 100 kB"
