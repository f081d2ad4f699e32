"""The library of the integrators is compiled anew when any of its files changes."""

from __future__ import annotations

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
