"""The library of the integrators is compiled again when any of its files changes; its declarations are parsed once."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from codegen.runtime.sections import motion_files
from codegen.runtime.standalone.files.build import Build


@pytest.mark.parametrize("changed", sorted(name.removeprefix("motion/") for name in motion_files()))
def test_every_file_is_part_of_the_key(tmp_path: Path, changed: str) -> None:
    for name, text in motion_files().items():
        (tmp_path / name.removeprefix("motion/")).write_text(text, encoding="utf-8")
    sources = sorted(f.name for f in tmp_path.glob("*.c"))
    before = Build(tmp_path, "motion", sources).key()
    assert Build(tmp_path, "motion", sources).key() == before
    (tmp_path / changed).write_text("/* another one */\n" + (tmp_path / changed).read_text())
    assert Build(tmp_path, "motion", sources).key() != before


PARSED = """
import sys
from codegen.runtime.standalone.motion.library import Declarations, _interface, declarations
import subprocess
import sys
from pathlib import Path
ffi = _interface(Path({folder!r}))
problem = ffi.new("ordernm_problem *")
problem.rtol = 0.5
assert problem.rtol == 0.5 and ffi.sizeof("ordernm_results") > 100
print("pycparser" in sys.modules)
"""


def test_declarations_are_parsed_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "package"
    (folder / "motion").mkdir(parents=True)
    for name, text in motion_files().items():
        (folder / name).write_text(text, encoding="utf-8")

    def parses() -> str:
        ran = subprocess.run(
            [sys.executable, "-c", PARSED.format(folder=str(folder))], capture_output=True, text=True, check=True
        )
        return ran.stdout

    cache = tmp_path / "cache"
    monkeypatch.setenv("XDG_CACHE_HOME", str(cache))
    assert (parses(), parses()) == ("True\n", "False\n")  # nothing else is printed
    (kept,) = (cache / "ordernm" / "motion").glob("declarations-*.py")
    kept.write_text(kept.read_text()[:-100])  # a damaged file is replaced
    assert (parses(), parses()) == ("True\n", "False\n")
    with (folder / "motion" / "motion.h").open("a") as header:
        header.write("int another_function(void);\n")
    assert parses() == "True\n"
    monkeypatch.setenv("XDG_CACHE_HOME", "/proc/none")  # nothing can be kept there
    assert (parses(), parses()) == ("True\n", "True\n")
