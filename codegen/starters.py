"""First models for ``ordernm new``: one file each, with NAME in place of the name of the model."""

from __future__ import annotations

from pathlib import Path

FOLDER = Path(__file__).parent / "starter_models"

DEFAULT = "pendulum"


def starters() -> dict[str, str]:
    """Descriptions of the starters by their names, from the first lines of their files."""
    first = {path.stem: path.read_text(encoding="utf-8").partition("\n")[0] for path in sorted(FOLDER.glob("*.yaml"))}
    return {name: line.partition(": ")[2] for name, line in first.items()}


def text_of(starter: str, name: str) -> str:
    """The text of a starter for a model with the given name."""
    return (FOLDER / f"{starter}.yaml").read_text(encoding="utf-8").replace("NAME", name)
