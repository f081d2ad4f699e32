"""Choose the dependent speeds, component by component: compare choices, improve them, or warn that they are poor."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ..model.vectors import Array
from ..records import dataclass
from .comparison import ACCEPTED, WORTH_IT, Comparison
from .conditioning import Conditioning, is_compared
from .errors import loops_named
from .geometry import Geometry
from .nearby_states import NearbyStates, rigid_parts
from .ordering import Draft

POOR_GROWTH = 1e5
"""Ratio of a dependent speed to the independent ones above which a warning is issued, if choices are not compared."""

POOR_HINTS = 100.0
"""Factor by which the condition number with the model's hints may exceed that of pivoting before a warning is
issued."""

ELSEWHERE = 2
"""Number of other configurations at which choices are compared; see `Choice.elsewhere`."""

SEED = 19900117
"""Seed of the random states, the same for every component."""


@dataclass(frozen=True, slots=True)
class Choice:
    """A choice of ears and dependents, with its conditioning.

    Attributes
    ----------
    drafts : list of Draft
    growth : (nu,) array
        As returned by `Sweep.growth`.
    growth_of_uncompared : float
        The largest growth of a dependent speed in components that are not compared.
    compared : tuple of Comparison
    uncompared : int
        Number of loops in components that are not compared.
    warnings : tuple of str
    elsewhere : (S, nq + 1) array
        Configurations far from the initial one, with the compared loops closed as well as possible. They are more
        informative if the initial configuration is a special pose.
    """

    drafts: list[Draft]
    growth: Array
    growth_of_uncompared: float
    compared: tuple[Comparison, ...]
    uncompared: int
    warnings: tuple[str, ...]
    elsewhere: Array


def choose(
    geometry: Geometry,
    drafts: list[Draft],
    growth: Array,
    q: Array,
    held: set[int],
    components: Sequence[Sequence[int]],
) -> Choice:
    """Compare the choice in every component, and replace it where another choice is clearly better.

    Parameters
    ----------
    drafts : list of Draft
        All ears.
    growth : (nu,) array
        As returned by `Sweep.growth`.
    q : (1, nq + 1) array
        An assembled configuration.
    held : set of int
        Speeds that must stay independent.
    components : sequence of sequence of int
        Sets of loops that share joints.
    """
    of_loop = {i: n for n, loops in enumerate(components) for i in loops}
    ears: list[list[Draft]] = [[] for _ in components]
    for draft in drafts:
        ears[of_loop[draft.loops[0]]].append(draft)
    small = [n for n, loops in enumerate(components) if is_compared(geometry, loops, ears[n])]
    compared: list[Comparison] = []
    warnings: list[str] = []
    elsewhere = np.repeat(q, ELSEWHERE, axis=0)
    if small:
        groups = rigid_parts(geometry, q, [components[n] for n in small])
        for n in small:
            order = [i for d in ears[n] for i in d.loops]
            nearby = NearbyStates(groups, components[n], q, np.random.default_rng(SEED))
            elsewhere = nearby.put(elsewhere)
            conditioning = Conditioning(nearby, order, held, sum(len(d.dependent) for d in ears[n]), SEED)
            ears[n], found = conditioning.better(ears[n])
            without_hints = None
            if held.intersection(conditioning.speeds):
                without_hints = Conditioning(nearby, order, set(), conditioning.rank, SEED)
                found = without_hints.compare(ears[n])
            compared.append(found)
            if found.loss > (ACCEPTED if without_hints is None else POOR_HINTS):
                warnings.append(_poor(geometry, found, without_hints))
        drafts = _in_their_places(drafts, ears, of_loop)
        for draft in drafts:  # the comparison of choices has changed the characteristic lengths
            geometry.lengths[list(draft.loops)] = np.max(geometry.own_lengths[list(draft.loops)])
    rest = [n for n in range(len(components)) if n not in small]
    dependent = [s for n in rest for d in ears[n] for s in d.dependent]
    worst = float(np.max(growth[dependent], initial=0.0))
    if worst > POOR_GROWTH:
        name = geometry.model.speed_names[max(dependent, key=lambda s: float(growth[s]))]
        warnings.append(
            f"{name} is {worst:.1e} times as fast as the independent speeds that determine it, and as many times less "
            f"accurate; other coordinates under `independent` may do better"
        )
    uncompared = sum(len(components[n]) for n in rest if any(d.dependent for d in ears[n]))
    return Choice(drafts, growth, worst, tuple(compared), uncompared, tuple(warnings), elsewhere if small else q[:0])


def _in_their_places(drafts: list[Draft], ears: list[list[Draft]], of_loop: dict[int, int]) -> list[Draft]:
    """The ears of all components in one list; the positions of each component's ears stay the same."""
    left: list[Iterator[Draft]] = [iter(x) for x in ears]
    result = [d for old in drafts for d in (next(left[of_loop[old.loops[0]]], None),) if d is not None]
    return result + [d for more in left for d in more]


def _poor(geometry: Geometry, found: Comparison, without_hints: Conditioning | None) -> str:
    """Warning about a poor choice; `without_hints` compares choices without the model's hints, if the model has hints
    for these loops."""
    model = geometry.model
    text = (
        f"{loops_named(model, found.loops)}: the condition number of the closure matrix of all dependents is {found.loss:.0f} "
        f"times that of the matrix that pivoting finds, here or at other assembled states"
    )
    other = without_hints.own_choice() if without_hints is not None else None
    if without_hints is not None and other is not None and other[1].loss * WORTH_IT < found.loss:
        dependent = {s for d in other[0] for s in d.dependent}
        hint = ", ".join(independent_names(geometry, without_hints.speeds, dependent))
        return f"{text}; with `independent: [{hint}]` the ratio is {other[1].loss:.1f}, and omitting the hints may do as well"
    return f"{text}; other coordinates under `independent`{', or none,' * (without_hints is not None)} may do better"


def independent_names(geometry: Geometry, speeds: Sequence[int], dependent: set[int]) -> Iterator[str]:
    """Names under `independent` with which the choice is the given one, or as near to it as possible; a quaternion
    joint is named whole."""
    model = geometry.model
    bodies = dict.fromkeys(int(geometry.speed_body[s]) for s in speeds)
    for k in bodies:
        mine = geometry.speeds[k]
        if geometry.whole[k]:
            if not dependent.intersection(mine):
                yield model.bodies[k].name
        else:
            yield from (model.coordinate_names[geometry.coordinate[s]] for s in mine if s not in dependent)
