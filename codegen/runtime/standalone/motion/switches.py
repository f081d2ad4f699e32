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


def not_held(manifest: Mapping[str, Any], number: int) -> str:
    """What is said of a switch that was passed where its branch has no value beyond it."""
    return (
        f"the motion passes where {switch_words(manifest, number)} changes its branch, and one branch has no value beyond it, "
        f"as a root of a negative number: if the force jumps there, derivatives lack that jump; write max(0, ..) in the root "
        f"or power"
    )


def order_matters(manifest: Mapping[str, Any], t: float, first: int, second: int) -> str:
    """The warning for two switches that are passed at one time, whose order derivatives depend on."""
    return (
        f"at t = {t:.9g} s the motion passes where {switch_words(manifest, first)} and where "
        f"{switch_words(manifest, second)} change their branches at one time; derivatives along which it matters which comes "
        f"first do not exist, and are NaN from there on"
    )


def event_order_matters(manifest: Mapping[str, Any], t: float, switch: int, event: str) -> str:
    """The warning for an event at a switch, where its derivatives depend on which comes first."""
    return (
        f"at t = {t:.9g} s the event {event} comes where {switch_words(manifest, switch)} changes its branch; derivatives of the "
        f"event for which it matters which comes first do not exist, and are NaN"
    )


def passed_late(manifest: Mapping[str, Any], t: float, switch: int) -> str:
    """The warning for a switch at a pose where a loop loses rank, at which no step can end."""
    return (
        f"at t = {t:.9g} s the motion passes where {switch_words(manifest, switch)} changes its branch while a loop loses rank, "
        f"so no step can end there: its old branch is kept up to a tenth of a step longer, and results and derivatives behind it "
        f"are only as exact as that; move the switch off this pose, or take smaller steps (largest_step)"
    )
