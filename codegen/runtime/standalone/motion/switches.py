"""Messages about switches of a motion, where forces or outputs change their branch."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def switch_words(manifest: Mapping[str, Any], number: int) -> str:
    """Describes a switch of a model: ``sign(u.block) in forces.friction.value``."""
    switch = manifest["switches"][number]
    return f"{switch['changes']} in {', '.join(switch['places'])}"


def touched(manifest: Mapping[str, Any], number: int) -> str:
    """The warning for a switch that a motion only touches."""
    return (
        f"the motion only touches a switch, where {switch_words(manifest, number)} changes its branch: there are no derivatives, "
        f"and the returned ones are one-sided"
    )


def not_held(manifest: Mapping[str, Any], number: int) -> str:
    """The warning for a switch whose branch has no value on the other side."""
    return (
        f"the motion passes where {switch_words(manifest, number)} changes its branch, and one branch has no value on the other "
        f"side, such as the root of a negative number. If the force jumps there, derivatives lack that jump; write max(0, ..) in "
        f"the root or power"
    )


def order_matters(manifest: Mapping[str, Any], t: float, first: int, second: int) -> str:
    """The warning for two switches at the same time, if derivatives depend on their order."""
    return (
        f"at t = {t:.9g} s the motion passes where {switch_words(manifest, first)} and where "
        f"{switch_words(manifest, second)} change their branches at the same time; derivatives that depend on the order "
        f"do not exist, and are NaN from there on"
    )


def event_order_matters(manifest: Mapping[str, Any], t: float, switch: int, event: str) -> str:
    """The warning for an event at a switch, if its derivatives depend on the order."""
    return (
        f"at t = {t:.9g} s the event {event} occurs where {switch_words(manifest, switch)} changes its branch; derivatives of "
        f"the event that depend on the order do not exist, and are NaN"
    )


def passed_late(manifest: Mapping[str, Any], t: float, switch: int) -> str:
    """The warning for a switch at a pose where a loop loses rank, at which no step can end."""
    return (
        f"at t = {t:.9g} s the motion passes where {switch_words(manifest, switch)} changes its branch while a loop loses rank, "
        f"so no step can end there: its old branch is used for up to a tenth of a step longer, and later results and derivatives "
        f"have this error; move the switch off this pose, or take smaller steps (largest_step)"
    )
