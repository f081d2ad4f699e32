"""docs/equations.md and the docstrings of codegen.symbolic: their code runs and prints what they say."""

import contextlib
import doctest
import io
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "equations.md").read_text(encoding="utf-8")


def test_the_page_prints_what_it_says(monkeypatch):
    monkeypatch.chdir(ROOT)
    known: dict = {}
    blocks = re.findall(r"^```python\n(.*?)^```\n(?:```text\n(.*?)^```\n)?", PAGE, re.MULTILINE | re.DOTALL)
    assert len(blocks) == PAGE.count("```python")
    for code, expected in blocks:
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            exec(compile(code, "docs/equations.md", "exec"), known)
        assert printed.getvalue() == expected


@pytest.mark.parametrize("module", ["motion", "polynomials", "recursion"])
def test_examples_of_docstrings(module, monkeypatch):
    monkeypatch.chdir(ROOT)
    found = __import__(f"codegen.symbolic.{module}", fromlist=["*"])
    assert doctest.testmod(found).failed == 0
