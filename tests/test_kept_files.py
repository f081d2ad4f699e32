"""Files that tests keep for later runs: only for the same generator, and only up to a total size."""

from __future__ import annotations

import os
from pathlib import Path

import kept_files
import pytest
from kept_files import Generator, make_room, put, used


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name in ("codegen", "templates", "tests"):
        (tmp_path / name).mkdir()
    (tmp_path / "codegen" / "a.py").write_text("one")
    (tmp_path / "templates" / "b.jinja").write_text("two")
    (tmp_path / "tests" / "once_a_run.py").write_text("three")
    monkeypatch.setattr(kept_files, "CHECKOUT", tmp_path)
    monkeypatch.setattr(kept_files, "__file__", str(tmp_path / "tests" / "kept_files.py"))
    return tmp_path


@pytest.mark.parametrize("name", ["codegen/a.py", "templates/b.jinja", "tests/once_a_run.py"])
def test_nothing_is_kept_once_the_generator_has_changed(checkout: Path, name: str) -> None:
    before = Generator()
    assert before.unchanged() and Generator().key == before.key
    (checkout / name).write_text("changed")
    assert not before.unchanged()
    assert Generator().key != before.key
    (checkout / name).unlink()
    assert not before.unchanged()


def test_new_files_make_another_generator(checkout: Path) -> None:
    before = Generator()
    (checkout / "codegen" / "new.py").write_text("new")
    assert Generator().key != before.key


def test_compiled_modules_do_not_count(checkout: Path) -> None:
    before = Generator()
    (checkout / "codegen" / "__pycache__").mkdir()
    (checkout / "codegen" / "__pycache__" / "a.pyc").write_text("compiled")
    assert before.unchanged() and Generator().key == before.key


def test_other_versions_of_libraries_are_another_generator(checkout: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = Generator().key
    monkeypatch.setattr(kept_files, "version", lambda name: "0.0")
    assert Generator().key != before


def test_files_that_were_used_last_stay(tmp_path: Path) -> None:
    for age, name in enumerate(("new", "middle", "old", "oldest")):
        put(tmp_path / name, b"x" * 10)
        os.utime(tmp_path / name, (1e9 - age, 1e9 - age))
    assert used(tmp_path / "oldest") and not used(tmp_path / "none")
    (tmp_path / "gone").symlink_to("no such file")  # listed, but without a status
    make_room(tmp_path, 25)
    assert {f.name for f in tmp_path.iterdir()} == {"oldest", "new", "gone"}
