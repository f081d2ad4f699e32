"""Accelerations, their derivatives, and rates of coordinates and speeds."""

from __future__ import annotations

from ...program.procedure import WIDTHS, Columns, IfAsked, Own, Procedure, Step, Take, Together, Zero
from ..quantities import run
from . import columns
from .shared import Shared


def dynamics(w: Shared) -> list[Procedure]:
    equations = "Eqs. 18-24, 30-56" if w.loops else "Eqs. 18-24, 42-56"
    return w.pair(
        ("accelerations", "sensitivities"),
        (
            f"Forward dynamics ({equations}).",
            "Forward dynamics and its total derivative along seeds (Eqs. 9, 10, by the balance).",
        ),
        w.state,
        ["udot"],
        (*w.begin, *w.forward),
        (*w.begin, *w.forward, *w.along, w.balance),
        WIDTHS,
    )


def jacobians(w: Shared) -> Procedure:
    """The function for partial derivatives of udot. For trees, all columns for coordinates and speeds are computed at
    once, and other columns in groups of directions."""
    dudot = w.one("dudot")
    free = dict(zip(("q", "u"), w.system.independent, strict=True)) if w.loops else {}
    seeds = {n: w.one(f"d{n}") for n in w.state}
    if w.loops:
        seeds |= {n: seeds[n].called(f"given_d{n}") for n in ("q", "u")}
    zero: list[Step] = [Own(dudot)]
    for seed in seeds.values():
        zero += [Own(seed), Zero(seed)]

    def one_by_one(n: str) -> Step:
        matrix = w.one(f"J_{n}")
        among = tuple(free[n]) if n in free else None
        return IfAsked((matrix,), (Columns(seeds[n], (*w.along, w.balance), (Take(matrix, dudot),), among),))

    state = ["q", "u"]
    primitives = columns.force_primitives(w) if columns.applies(w.system) else None
    weighted = primitives.weighted if primitives is not None else ()
    driven = ["inputs"] if "inputs" in seeds and "inputs" not in w.p else []
    rest = [n for n in seeds if n not in (*state, *driven)]
    steps: list[Step] = [*w.begin, *w.forward]
    if primitives is None:
        steps += [*zero, *map(one_by_one, seeds)]
    else:
        by_state, J_q, J_u = columns.by_state(w), *w.of("J_q", "J_u")
        found: list[Step] = []
        if rest or weighted:
            found += zero
        found.append(IfAsked((J_q, J_u), (*run("found_motion", "turning"), by_state)))
        if driven:
            found.append(IfAsked(w.of("J_inputs"), (Zero(w.one("J_inputs")),)))
        if weighted:
            needed = tuple(dict.fromkeys(x.into for x in weighted))
            found.append(IfAsked(needed, (primitives, columns.by_forces(w, weighted))))
        found += map(one_by_one, rest)
        steps.append(Together(tuple(found), (*zero, *map(one_by_one, seeds))))
    results = w.of("udot", *(f"J_{n}" for n in w.state))
    doc = "Accelerations and their partial derivatives, row by row; a result that is NULL is skipped."
    return Procedure("jacobians", doc, w.of(*w.state), results, tuple(steps))


def rates(w: Shared) -> list[Procedure]:
    begin = w.begin if w.loops else run("rotations")
    along = w.along if w.loops else run("turns")
    return w.pair(
        ("coordinate_rates", "coordinate_rate_sensitivities"),
        (
            "Time derivatives of the coordinates (Eq. 1).",
            "Time derivatives of the coordinates and their total derivative along seeds.",
        ),
        ["q", "u", *(w.p if w.loops else [])],
        ["qdot"],
        (*begin, *run("rates")),
        (*begin, *along, *run("rate_tangents")),
    )


def state_rates(w: Shared) -> list[Procedure]:
    """The rates that integration evaluates at every stage, computed in one call."""
    begin = (*w.begin, *run("rates"), *w.forward)
    return w.pair(
        ("state_rates", "state_rate_sensitivities"),
        (
            "Time derivatives of coordinates and speeds, for integration over time (Eq. 1 and forward dynamics).",
            "Time derivatives of coordinates and speeds, and their total derivative along seeds (Eqs. 2, 3).",
        ),
        w.state,
        ["qdot", "udot"],
        begin,
        (*begin, *w.along, w.balance, *run("rate_tangents")),
    )
