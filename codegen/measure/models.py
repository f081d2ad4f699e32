"""Model files that the benchmark shares with the examples: in ``examples/`` of a checkout, inside the package in a wheel."""

from __future__ import annotations

from pathlib import Path


def example(name: str) -> str:
    """The text of a shipped model."""
    package = Path(__file__).resolve().parents[1]
    places = [package / "examples", package.parent / "examples"]
    found = next((file for folder in places if (file := folder / f"{name}.yaml").is_file()), None)
    if found is None:
        raise FileNotFoundError(2, "this installation lacks a model of the benchmark", f"{name}.yaml")
    return found.read_text(encoding="utf-8")


def changed(name: str, old: str, new: str) -> str:
    """A shipped model in which one piece of text, which is there once, is another one."""
    text = example(name)
    if text.count(old) != 1:
        raise ValueError(f"{name}.yaml does not say {old!r} once, as the benchmark expects")
    return text.replace(old, new)
