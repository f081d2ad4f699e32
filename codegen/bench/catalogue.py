"""All problems of the benchmark by name."""

from __future__ import annotations

from collections.abc import Sequence

from ..ending import Failure
from ..wording import nearest
from .problem import Family, Motion, Problem, Robots
from .problems import families, four_bars, motions, pendulum, planar_chains

ROBOTS = Robots(
    name="robots",
    title="Jacobians, mass matrices and batches of robots given as URDF",
    source="Pinocchio's aba, computeABADerivatives, crba and computeMinverse on the same robot in the same state",
    models=("CHAIN(7)", "CHAIN(24)", "UR5", "Panda", "Solo12", "ANYmal", "G1", "Talos"),
    quick=("CHAIN(7)",),
    within=1e-9,
)
MODULES = (pendulum, four_bars, motions, families, planar_chains)
PROBLEMS: dict[str, Problem] = {p.name: p for p in (*(p for module in MODULES for p in module.PROBLEMS), ROBOTS)}

KINDS = ("motions", "families")
"""Words on the command line that select all problems of one kind."""


class UnknownProblemError(Failure, ValueError):
    """Raised if no problem has the given name."""


def chosen(names: Sequence[str]) -> list[Problem]:
    """The problems with these names, in the order of the catalogue; without names, all problems.

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
            raise UnknownProblemError(
                f"there is no problem {name!r}; there are {', '.join(PROBLEMS)}, and motions or families for all of a kind"
                f"{nearest(name, PROBLEMS)}"
            )
    return [p for n, p in PROBLEMS.items() if not names or n in wanted]
