"""Switches of a motion in words: where forces or outputs change their branch."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def switch_words(manifest: Mapping[str, Any], number: int) -> str:
    """A switch of a model in words: ``sign(u.block) in forces.friction.value``."""
    switch = manifest["switches"][number]
    return f"{switch['changes']} in {', '.join(switch['places'])}"


def touched(manifest: Mapping[str, Any], number: int) -> str:
    """What is said of a switch that a motion has only touched."""
    return (
        f"the motion only touches where {switch_words(manifest, number)} changes its branch: derivatives do not exist there, "
        f"and those that are returned are of one side"
    )
