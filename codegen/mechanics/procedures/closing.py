"""Functions for closed loops, which compute residuals and close the loops, and functions for initial values."""

from __future__ import annotations

from dataclasses import replace

from ...program.procedure import (
    Bind,
    Copy,
    Own,
    Procedure,
    Step,
    Tolerate,
    Zero,
)
from ..quantities import run
from .shared import Shared
from .words import INITIAL, OTHER_WIDTHS


def closing(w: Shared) -> list[Procedure]:
    position, velocity, step, condition = w.of("position", "velocity", "step", "condition")
    given = w.one("u").called("given_u")
    state, places = w.of("q", "u", *w.p), w.of("q", *w.p)
    return [
        Procedure(
            "closure",
            "Scaled residuals of all loops, of position and velocity.",
            state,
            (position, velocity),
            (Tolerate(), w.start, *run("residuals")),
            basic=True,
        ),
        Procedure(
            "conditions",
            "Condition number of the closure matrix to which each loop belongs.",
            places,
            (condition,),
            (Own(given), Zero(given), *w.begin, *run("condition_numbers")),
            basic=True,
        ),
        Procedure(
            "newton_step",
            "Newton's step of the dependent coordinates towards closure.",
            places,
            (step,),
            (Zero(step), Own(given), Zero(given), *w.begin, *run("correct")),
            basic=True,
        ),
        Procedure(
            "closing_step",
            "Newton's step, the scaled position residuals before it, and the condition numbers.",
            places,
            (step, position, condition),
            (
                *(Zero(step), Own(given), Zero(given), *w.begin, Own(velocity)),
                *run("residuals", "correct", "condition_numbers"),
            ),
        ),
        *_completing(w),
    ]


def _completing(w: Shared) -> list[Procedure]:
    """Functions that compute dependent speeds, dependent entries of seeds, and the position residuals along seeds."""
    u, full_u, dfull_q, dfull_u, dq, du = w.of("u", "full_u", "dfull_q", "dfull_u", "dq", "du")
    position, velocity, dposition = w.of("position", "velocity", "dposition")
    state, seeds = w.of("q", "u", *w.p), w.of("dq", "du", *(f"d{name}" for name in w.p))
    return [
        Procedure(
            "completion",
            "All speeds; the dependent ones follow from velocity closure.",
            state,
            (full_u,),
            (*w.begin, Copy(full_u, u)),
            basic=True,
        ),
        Procedure(
            "completion_sensitivities",
            "All speeds and complete seeds; the dependent entries follow from closure.",
            state,
            (full_u, dfull_q, dfull_u),
            (*w.begin, *w.along, Copy(full_u, u), Copy(dfull_q, dq), Copy(dfull_u, du)),
            seeds,
            OTHER_WIDTHS,
            "assemble_sensitivities",
        ),
        Procedure(
            "closure_sensitivities",
            "Position residuals of loops, and their derivative along complete seeds.",
            state,
            (position, dposition),
            (
                *w.begin,
                Own(velocity),
                *run("residuals"),
                *w.along,
                Zero(dposition),
                *run("seed_residuals"),
            ),
            seeds,
            OTHER_WIDTHS,
            basic=bool(w.system.partition and w.system.partition.opening),
        ),
    ]


def initial(w: Shared) -> list[Procedure]:
    results = w.of("q", "u")
    bound: tuple[Step, ...] = tuple(Bind(r.called(f"initial_{r.name}"), r) for r in results)
    along: tuple[Step, ...] = tuple(Bind(r.tangent(f"dinitial_{r.name}"), r.tangent()) for r in results)
    values, tangents = w.pair(
        ("initial", "initial_sensitivities"),
        (
            "Initial values of the model file, before loops are closed.",
            "Initial values and their total derivative along seeds.",
        ),
        ["p"],
        ["q", "u"],
        (*bound, INITIAL),
        (*bound, *along, INITIAL, INITIAL.tangents()),
    )
    return [replace(values, basic=True), tangents]
