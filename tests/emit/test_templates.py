"""Compiled templates are cached, as Python caches compiled modules."""

import sys
from pathlib import Path

import jinja2
import pytest

from codegen.emit.templates import KeptBeside


@pytest.fixture
def environment(tmp_path, monkeypatch):
    """A template environment for a folder with one template, which also stores the byte code."""
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    monkeypatch.setattr(sys, "pycache_prefix", None)
    (tmp_path / "one.jinja").write_text("{{ x }} is {{ x }}")

    def made():
        loader = jinja2.FileSystemLoader(tmp_path)
        return jinja2.Environment(loader=loader, bytecode_cache=KeptBeside(tmp_path))

    return made


def kept(folder: Path) -> list[Path]:
    return list((folder / "__pycache__").iterdir()) if (folder / "__pycache__").exists() else []


def text(environment):
    return environment().get_template("one.jinja").render(x=1)


def test_a_template_is_compiled_once(environment, tmp_path, monkeypatch):
    assert text(environment) == "1 is 1"
    (file,) = kept(tmp_path)
    assert sys.implementation.cache_tag in file.name and jinja2.__version__ in file.name
    with monkeypatch.context() as patched:
        patched.setattr(jinja2.Environment, "_generate", lambda *_: pytest.fail("compiled anew"))
        assert text(environment) == "1 is 1"
    (tmp_path / "one.jinja").write_text("{{ x }} was {{ x }}")
    assert text(environment) == "1 was 1"


def test_what_is_damaged_is_compiled_anew(environment, tmp_path):
    text(environment)
    (file,) = kept(tmp_path)
    whole = file.read_bytes()
    for content in (b"", whole[:40], whole[:-5], b"nothing"):
        file.write_bytes(content)
        assert text(environment) == "1 is 1"


def test_nothing_is_kept_where_python_keeps_nothing(environment, tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    assert text(environment) == "1 is 1"
    assert not kept(tmp_path)


def test_a_folder_that_cannot_be_written_is_no_reason_to_fail(environment, tmp_path):
    (tmp_path / "__pycache__").write_text("a file where the folder would be")
    assert text(environment) == "1 is 1"
