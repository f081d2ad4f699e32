"""docs/equations.md: its code runs and prints what the page shows."""

import contextlib
import io
import re
from pathlib import Path

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
