"""The program for fmpy in docs/howto/fmi.md runs."""

import contextlib
import io
import re
from pathlib import Path

import pytest

pytest.importorskip("fmpy", reason="needs the extra fmi")

PAGE = Path(__file__).parents[3] / "docs" / "howto" / "fmi.md"


def test_the_program_of_the_page_runs(tmp_path, monkeypatch):
    text = PAGE.read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    Path("swing.yaml").write_text(re.search(r"```yaml\n(.*?)```", text, re.DOTALL)[1])
    program = text[text.index("    import fmpy\n") :]
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(compile(re.sub(r"^    ", "", program, flags=re.MULTILINE), "page", "exec"), {})
    assert -0.8 < float(printed.getvalue()) < 0.8
