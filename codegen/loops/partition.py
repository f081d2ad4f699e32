"""The partition: which speeds are dependent, and in which order the loops are closed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

import numpy as np

from ..model.model import Model
from ..model.vectors import Array
from .assembling import (
    assembled,
    first_assembly,
    initial_configuration,
    is_closed,
    is_nearly_closed,
    loose_loops,
    settled_together,
)
from .choosing import Choice, choose
from .components import components
from .demands import check_couplings, check_cycles, hinted
from .dependents import condition
from .doubts import POOR_CONDITION, doubts_of, ignored_speeds, moved_far, nearly_locked, stopped
from .ears import Ear, Partition
from .errors import AssemblyError, PartitionError, listed, loops_named
from .geometry import Geometry, advance, padded
from .odd_axes import axes_to_check
from .ordering import Draft, Sweep, arrange, loop_order
from .redundancy import FAR, Redundancy, keep, kept_rows, nearly_redundant, opening, remark, turned_round
from .tangles import closed_together
from .velocities import Motion

__all__ = ["Ear", "Partition", "partition"]

NEARBY = 2
"""Number of configurations near the initial one that are examined if the initial one may be singular."""

DISTANCE = 0.08
"""Distance of the nearby configurations from the initial one, rad and characteristic lengths."""

FEW = 100
"""Largest number of ears whose redundant conditions are examined at several configurations."""

OTHERS = 3
"""Number of further configurations at which redundant conditions are examined."""

PARTS = (0.5,) * 4 + (0.2,) * 3 + (0.1, 0.1, 0.05)
"""Distances, rad and characteristic lengths, at which further configurations are searched for until `OTHERS` are found. The first
distances are large, because nearby configurations may all be special."""

SEED = 20030617
"""Seed of the random numbers, so that equal models have equal partitions."""


class _NotNearlyClosed(PartitionError):
    """Raised if a loop stays open in a condition that is not redundant and must be closed to rounding."""


@np.errstate(
    all="ignore"
)  # numbers of a model may have any size: a loop whose numbers overflow does not close, and is reported
def partition(model: Model) -> Partition:
    """Choose the dependent speeds of a model and order its ears.

    Raises
    ------
    AssemblyError
        A loop cannot be closed.
    PartitionError
        A hint cannot be met, a loop has no degree of freedom to close with, or none is left at all.

    Notes
    -----
    A prescribed coordinate counts as independent. Speeds are those of `Model.released`, which has no prescribed motion.
    """
    prescribed, model = model.prescribed_names, model.released
    guess = padded(initial_configuration(model)[0])
    if not model.loops:
        return Partition((), tuple(range(model.nu)), tuple(float(x) for x in guess[0, : model.nq]))
    geometry = Geometry(model)
    try:
        return _found(model, geometry, guess)
    except PartitionError as error:
        refused = [n for n in prescribed if n in error.names]
        if not refused:
            raise
        named = loops_named(model, [i for i, x in enumerate(model.loops) if x.name in error.loops])
        several = len(refused) > 1
        raise PartitionError(
            f"{named}: {listed(refused)} cannot be prescribed{' together' * several}, because the loops determine too many of "
            f"these coordinates; remove {'one of them' if several else 'it'} from `motion`, or give the loop one more degree "
            f"of freedom"
        ) from None
    except np.linalg.LinAlgError:  # LinAlgError: a matrix contains numbers that are not finite
        widest = int(np.argmax(geometry.own_lengths))
        name, length = model.loops[widest].name, geometry.own_lengths[widest]
        raise PartitionError(
            f"loop {name}, whose joints are about {length:.1g} m apart, cannot be closed in floating-point numbers, because "
            f"squares of such lengths are too large; check lengths and units"
        ) from None


def _found(model: Model, geometry: Geometry, guess: Array) -> Partition:
    """The partition of a model that has loops."""
    random = np.random.default_rng(SEED)
    held = hinted(geometry)
    check_cycles(geometry)
    order = loop_order(geometry, held)
    open_ = set[int]()
    try:
        q, chosen, warnings, redundancy = _Choice(geometry, order, held, random, open_).of(guess)
    except (AssemblyError, PartitionError) as of_open:
        if not open_:
            raise
        geometry, random = Geometry(model), np.random.default_rng(SEED)
        try:
            q, chosen, warnings, redundancy = _Choice(geometry, order, held, random, None).of(guess)
        except AssemblyError:
            if isinstance(of_open, PartitionError) and not isinstance(of_open, _NotNearlyClosed):
                raise of_open from None
            raise
    check_couplings(model, chosen.drafts)
    warnings += [text for d in chosen.drafts for text in doubts_of(model, geometry, d, held)]
    warnings += _locked(geometry, chosen.drafts, q, random)
    drafts = _closed_together(geometry, chosen.drafts, q, redundancy)
    found = replace(
        _partition(geometry, drafts, q, [*warnings, *chosen.warnings], redundancy),
        compared=chosen.compared,
        uncompared=chosen.uncompared,
        growth=chosen.growth_of_uncompared,
    )
    ignored = [*moved_far(model, guess, q), *ignored_speeds(model, found)]
    return replace(found, warnings=(*found.warnings, *ignored)) if ignored else found


class _Choice:
    """Finds an assembled configuration, the ears, and their dependent speeds.

    Parameters
    ----------
    geometry : Geometry
    order : list of int
        Loops.
    held : set of int
        Speeds that must stay independent.
    random : np.random.Generator
    open_ : set of int or None
        Receives the loops that stay open by the model's tolerance in conditions that are then dropped; None if none may.
    """

    def __init__(
        self, geometry: Geometry, order: list[int], held: set[int], random: np.random.Generator, open_: set[int] | None
    ) -> None:
        self.geometry, self.order, self.held, self.random, self.open_ = geometry, order, held, random, open_
        self.shared = components(geometry)
        """Components: sets of loops that share joints."""
        self.warnings: list[str] = []
        self.stuck: list[int] = []

    def of(self, guess: Array) -> tuple[Array, Choice, list[str], Redundancy]:
        """An assembled configuration, its ears, warnings, and redundant conditions."""
        geometry, random = self.geometry, self.random
        if is_closed(geometry, guess):
            q, chosen = guess, self._choice(guess)
            return q, chosen, self.warnings, _redundancy(geometry, chosen, q, random, self.stuck)
        q, self.warnings = first_assembly(geometry, self.order, guess, self.held, random, self.open_)
        settled = self._settled(q, self.open_, self.held)
        if settled is None:
            raise _NotNearlyClosed("loops are open in conditions that joints change")
        q = settled
        chosen = self._choice(q)
        redundancy = _redundancy(geometry, chosen, q, random, self.stuck)
        if redundancy.dropped or self.open_:
            q = assembled(geometry, _partition(geometry, chosen.drafts, q, []), q)
        before, q = q, _near_guess(geometry, chosen.drafts, guess, q, self.warnings)
        if q is not before:
            drafts = _with_conditions_at(geometry, chosen.drafts, q)
            kept, geometry.kept = geometry.kept, [list(rows) for rows in geometry.rows]
            if max(d.condition for d in drafts) > POOR_CONDITION:
                chosen = self._choice(q)
            else:
                chosen = choose(geometry, drafts, chosen.growth, q, self.held, self.shared)
            if chosen.drafts == drafts:
                geometry.kept = kept
            else:
                redundancy = _redundancy(geometry, chosen, q, random, self.stuck)
        return q, chosen, self.warnings, redundancy

    def _choice(self, q: Array) -> Choice:
        """The ears at an assembled configuration, compared with other choices."""
        sweep, drafts = self._chosen(q)
        return choose(self.geometry, drafts, sweep.growth(), q, self.held, self.shared)

    def _chosen(self, q: Array) -> tuple[Sweep, list[Draft]]:
        """The ears at an assembled configuration, and if necessary at nearby configurations; stores the loops that are
        stuck."""
        geometry, order, self.stuck = self.geometry, self.order, []
        try:
            sweep = Sweep(geometry, q, self.held, self.random)
            drafts = arrange(sweep, order)
            if all(d.certain for d in drafts):
                return sweep, drafts
            doubtful = [i for d in drafts if not d.certain for i in d.loops]
        except PartitionError:  # the pose may be singular: configurations nearby decide about every loop
            doubtful = list(range(len(order)))
        configurations = [q, *self._nearby(q)]
        still = {i for i in doubtful if not _moves(geometry, i, configurations)}
        together = [loops for loops in self.shared if still.intersection(loops)]
        self.stuck = stuck = [i for loops in together for i in loose_loops(geometry, q, loops) if i in still]
        if self.open_ and self.open_.intersection(stuck):
            raise _NotNearlyClosed(
                "open loops that do not move in any configuration nearby do not count as nearly closed"
            )
        advice = (
            f"{loops_named(geometry.model, stuck)} cannot be closed in any other configuration near the initial one, which "
            f"seems to be singular, so its rank is not meaningful: start from another configuration, or check whether "
            f"lengths are just long enough"
        )
        # without configurations nearby, the sweep below decides about stuck loops
        if len(configurations) > 1:
            self._refuse_hints(stuck, advice)
        others = [x for x in configurations[1:] if any(_moves(geometry, i, [q, x]) for i in doubtful)]
        try:
            sweep = Sweep(geometry, np.concatenate([q, *others]), self.held, self.random)
            drafts = arrange(sweep, order)
        except PartitionError as error:
            message = f"{error}; {advice}" if stuck else str(error)
            raise PartitionError(message, error.loops, error.names) from None
        if stuck:
            ranks = [f"{len(d.dependent)} of {d.rows} conditions" for d in drafts if {*d.loops} & {*stuck}]
            self.warnings.append(f"{advice} (rank {listed(ranks)})")
        return sweep, drafts

    def _refuse_hints(self, stuck: list[int], advice: str) -> None:
        """Raises an error if hinted speeds prevent loops from closing."""
        geometry, model = self.geometry, self.geometry.model
        wrong = sorted(self.held & geometry.passed_speeds(stuck))
        if wrong:
            refused = [model.speed_names[s] for s in wrong]
            raise PartitionError(
                f"{loops_named(model, stuck)}: {listed(refused)} cannot be independent; remove "
                f"{'them' if len(wrong) > 1 else 'it'} from `independent`; {advice}",
                [model.loops[i].name for i in stuck],
                refused,
            )

    def _nearby(self, q: Array) -> Iterator[Array]:
        """Assembled configurations near a given one."""
        geometry = self.geometry
        size = np.where(geometry.turning, 1.0, np.median(geometry.lengths))
        for _ in range(NEARBY):
            step = self.random.uniform(-DISTANCE, DISTANCE, (1, geometry.nu)) * size
            start = advance(geometry, q, np.arange(geometry.nu), step)
            still_open = None if self.open_ is None else set[int]()
            with suppress(AssemblyError):
                found = first_assembly(geometry, self.order, start, set(), self.random, still_open)[0]
                settled = self._settled(found, still_open, set())
                if settled is not None:
                    yield settled

    def _settled(self, q: Array, open_: set[int] | None, held: set[int]) -> Array | None:
        """Coordinates at which the open loops of each component are nearly closed together; None if no such coordinates
        are found."""
        for loops in self.shared:
            if open_ and open_.intersection(loops):
                settled = settled_together(self.geometry, q, loops, held)
                if settled is None:
                    return None
                q = settled
        return q


def _redundancy(
    geometry: Geometry, chosen: Choice, q: Array, random: np.random.Generator, stuck: list[int]
) -> Redundancy:
    """Drop redundant conditions where necessary (changes `geometry.kept`), and find parameters that open redundant
    conditions.

    No condition of a stuck loop is dropped: if only one configuration is known and that is singular, conditions are
    redundant by chance.
    """
    result, drafts = Redundancy(), chosen.drafts
    if not any(d.rows > len(d.dependent) for d in drafts):
        return result
    loose = _partition(geometry, drafts, q, [])
    few = len(drafts) <= FEW
    # at the initial configuration conditions may be redundant by chance, or the pose special, such as a flat parallelogram
    open_ones = [q, *(_others(geometry, loose, q, random, nearly=True) if few else [])]
    found = {d.loops for x in open_ones for d in nearly_redundant(geometry, drafts, x, random)}
    found |= {d.loops for x in chosen.elsewhere for d in nearly_redundant(geometry, drafts, x[None], random, FAR)}
    nearly = [d for d in drafts if d.loops in found and not {*d.loops} & {*stuck}]
    for draft in nearly:
        rows = kept_rows(geometry, draft, open_ones)
        if turned := turned_round(geometry, draft, rows, [*open_ones, *(x[None] for x in chosen.elsewhere)]):
            geometry.turn_round(turned)
            rows = kept_rows(geometry, draft, open_ones)
        keep(geometry, draft, rows)
    configurations = open_ones
    if nearly:
        configurations = [q := assembled(geometry, loose, q)]
        configurations += _others(geometry, loose, q, random) if few else []
    for draft in nearly:
        keep(geometry, draft, kept_rows(geometry, draft, configurations))
        result.gaps.update(draft.loops)
        for i in draft.loops:
            result.dropped[i] = [n for n, r in enumerate(geometry.rows[i]) if r not in geometry.kept[i]]
        result.remarks.append(remark(geometry, draft, q))
    result.opening, opened = opening(geometry, drafts, configurations)
    result.gaps |= opened
    return result


def _locked(geometry: Geometry, drafts: list[Draft], q: Array, random: np.random.Generator) -> list[str]:
    """Warnings about motions that the loops nearly permit."""
    doubtful = [d for d in drafts if stopped(geometry, d, q)] if len(drafts) <= FEW else []
    if not doubtful:
        return []
    loose = _partition(geometry, drafts, q, [])
    return nearly_locked(geometry, doubtful, [q, *_others(geometry, loose, q, random)])


def _others(
    geometry: Geometry, loose: Partition, q: Array, random: np.random.Generator, nearly: bool = False
) -> list[Array]:
    """Further assembled configurations, up to half a radian from the given one; `nearly` is the argument of
    `assembled`."""
    speeds = np.array(loose.independent)
    size = np.where(geometry.turning[speeds], 1.0, float(np.median(geometry.lengths)))
    shared = components(geometry) if nearly else []
    found: list[Array] = []
    for part in PARTS:
        if len(found) == OTHERS:
            break
        with suppress(AssemblyError):
            step = random.uniform(-part, part, (1, len(speeds))) * size
            other = assembled(geometry, loose, advance(geometry, q, speeds, step), nearly)
            if all(is_nearly_closed(geometry, other, loops) for loops in shared):
                found.append(other)
    return found


def _moves(geometry: Geometry, loop: int, configurations: list[Array]) -> bool:
    """Whether the coordinates of a loop's joints differ between the first configuration and another one."""
    where = sorted({i for s in geometry.passed_speeds([loop]) for i in _places(geometry, s)})
    first, *others = (q[0, where] for q in configurations)
    return any(np.max(np.abs(q - first), initial=0.0) > DISTANCE / 20 for q in others)


def _places(geometry: Geometry, speed: int) -> list[int]:
    """Indices of the coordinates that a speed changes."""
    return list(range(geometry.moved[speed].start, geometry.moved[speed].stop))


def _near_guess(geometry: Geometry, drafts: list[Draft], guess: Array, q: Array, warnings: list[str]) -> Array:
    """The assembled configuration with the independent coordinates of the guess; `q` if no such configuration is found.

    Dependent coordinates start from the guess, then from `q`.
    """
    loose = _partition(geometry, drafts, guess, [])
    start = q.copy()
    for s in loose.independent:
        where = geometry.moved[s]
        start[:, where] = guess[:, where]
    if np.array_equal(start, q):
        return q
    for x in (guess, start):
        try:
            return assembled(geometry, loose, x)
        except AssemblyError as error:
            loop, residual = error.loop, error.residual
    places = sorted({i for s in loose.independent for i in _places(geometry, s) if guess[0, i] != q[0, i]})
    names = geometry.model.coordinate_names
    moved = listed([f"{names[i]} from {guess[0, i]:.4g} to {q[0, i]:.4g}" for i in places if i < geometry.nq])
    warnings.append(
        f"loop {loop} cannot be closed with the initial values of the independent coordinates (a residual of {residual:.2g} "
        f"characteristic lengths or rad remains); they were changed, {moved}: give other values under `initial`"
    )
    return q


def _closed_together(geometry: Geometry, drafts: list[Draft], q: Array, redundancy: Redundancy) -> list[Draft]:
    """The ears as they are computed: ears that couplings join become one ear, with the largest characteristic length.

    This matters only where conditions are redundant: the residual that a parameter opens is then shared by the whole ear.
    """
    order = closed_together(geometry, [d.loops for d in drafts], {s for d in drafts for s in d.dependent})
    found: list[Draft] = []
    for loops in order:
        parts = [d for d in drafts if d.loops[0] in loops]
        rows, dependent = sum(d.rows for d in parts), [s for d in parts for s in d.dependent]
        if rows - sum(len(redundancy.dropped.get(i, ())) for i in loops) == len(dependent):
            found += parts
            continue
        geometry.lengths[list(loops)] = np.max(geometry.lengths[list(loops)])
        found.append(Draft(loops, dependent, rows, parts[0].condition, all(d.certain for d in parts)))
    return drafts if len(found) == len(drafts) else _with_conditions_at(geometry, found, q)


def _with_conditions_at(geometry: Geometry, drafts: list[Draft], q: Array) -> list[Draft]:
    """The ears with their condition numbers at another configuration."""
    motion = Motion(geometry, q, np.zeros((1, geometry.nu, 1)))
    result = []
    for draft in drafts:
        closure = motion.closure(draft.loops)
        E = closure.weighed(geometry, float(geometry.lengths[draft.loops[0]]))
        result.append(replace(draft, condition=condition(E[..., [closure.column[s] for s in draft.dependent]])))
        motion.groups.found(closure.bodies, motion.u)
    return result


def _partition(
    geometry: Geometry,
    drafts: list[Draft],
    q: Array,
    warnings: list[str],
    redundancy: Redundancy | None = None,
) -> Partition:
    dependent = {s for d in drafts for s in d.dependent}
    independent = tuple(s for s in range(geometry.nu) if s not in dependent)
    if not independent:
        raise PartitionError(
            f"no freedom left: closing {listed([x.name for x in geometry.model.loops])} takes all {geometry.nu} speeds "
            f"(rank {len(dependent)}); remove a loop{' or a coupling' * bool(geometry.couplings)}, give a joint one more "
            f"degree of freedom, or {axes_to_check(geometry, range(len(geometry.model.loops)))}"
        )
    known = redundancy or Redundancy()
    ears = tuple(_ear(geometry, d, known) for d in drafts)
    return Partition(
        ears,
        independent,
        tuple(float(x) for x in q[0, : geometry.nq]),
        tuple(warnings),
        remarks=tuple(known.remarks),
        opening=tuple(sorted(known.opening)),
        turned=tuple(i for i, x in enumerate(geometry.model.loops) if x.turned),
    )


def _ear(geometry: Geometry, draft: Draft, redundancy: Redundancy) -> Ear:
    path: list[int] = []
    chosen = set(draft.dependent)
    outward = sorted({int(geometry.speed_body[s]) for s in chosen}, key=geometry.depth.__getitem__)
    ancestry = geometry.ancestry
    for loop in draft.loops:
        if loop in geometry.couplings:
            path += [int(s) for s in geometry.couplings[loop].speeds if s in chosen and s not in path]
            continue
        start, end = geometry.starts[loop], geometry.ends[loop]
        base = geometry.depth[ancestry.meeting(start, end)]
        for side in (start, end):
            here = [k for k in outward if geometry.depth[k] > base and ancestry.carries(k, side)]
            path += [s for k in here for s in geometry.speeds[k] if s in chosen and s not in path]
    length = float(geometry.lengths[draft.loops[0]])
    dropped = tuple((i, n) for i in draft.loops for n in redundancy.dropped.get(i, ()))
    gaps = bool(redundancy.gaps & {*draft.loops})
    return Ear(draft.loops, tuple(path), draft.rows, len(path), draft.condition, length, dropped, gaps)
