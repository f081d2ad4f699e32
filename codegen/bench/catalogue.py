"""All problems of the benchmark by name."""

from __future__ import annotations

import difflib
from collections.abc import Sequence

from ..ending import Failure
from .problem import Family, Motion, Problem
from .problems import (
    andrews,
    bricard,
    cart_pole,
    chain_motion,
    families,
    flyball,
    four_bars,
    pendulum,
    planar_chains,
    robots,
)

PROBLEMS: dict[str, Problem] = {
    p.name: p
    for module in (
        pendulum,
        four_bars,
        andrews,
        bricard,
        flyball,
        cart_pole,
        chain_motion,
        families,
        planar_chains,
        robots,
    )
    for p in module.PROBLEMS
}

KINDS = ("motions", "families")
"""Words that stand for all problems of a kind."""


class UnknownProblemError(Failure, ValueError):
    """A name that no problem has."""


def chosen(names: Sequence[str]) -> list[Problem]:
    """The problems with these names, in the order of the catalogue; all if there are none.

    Raises
    ------
    UnknownProblemError
    """
    wanted: set[str] = set()
    for name in names:
        if name in KINDS:
            wanted |= {n for n, p in PROBLEMS.items() if isinstance(p, Motion if name == "motions" else Family)}
        elif name in PROBLEMS:
            wanted.add(name)
        else:
            near = difflib.get_close_matches(name, PROBLEMS, 1)
            hint = f" (did you mean {near[0]}?)" if near else ""
            raise UnknownProblemError(
                f"there is no problem {name!r}{hint}; there are {', '.join(PROBLEMS)}, and motions or families for all of a kind"
            )
    return [p for n, p in PROBLEMS.items() if not names or n in wanted]
