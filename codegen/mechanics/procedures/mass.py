"""Mass matrix, solutions of linear systems with it, and inverse dynamics, for trees."""

from __future__ import annotations

from ...program.procedure import (
    Array,
    Bind,
    Check,
    Columns,
    Combine,
    Copy,
    Own,
    Procedure,
    Single,
    Step,
    Take,
    Together,
    Zero,
)
from ..quantities import run
from . import columns
from .shared import Shared
from .words import JOINT_FORCES


def mass(w: Shared) -> list[Procedure]:
    udot, force, dforce, b, dudot = w.of("udot", "force", "dforce", "b", "dudot")
    dM, M, inverse = w.of("dM", "M", "inverse_M")
    right = b.tangent("b")

    def by_columns(sweeps: tuple[Step, ...], found: Array, into: Array) -> tuple[Step, ...]:
        """Steps that compute a symmetric matrix column by column, from unit right sides."""
        return (Own(right), Zero(right), Own(found), Columns(right, sweeps, (Take(into, found, symmetric=True),)))

    matrix = by_columns(run("mass_out", "mass_in"), dforce, M)
    inverted = by_columns(SOLVE, dudot, inverse)
    if columns.applies(w.system):
        matrix = (Together((*run("composite"), columns.mass(w)), matrix),)
        inverted = (Together((columns.inverse_mass(w),), inverted),)
    return [
        *w.pair(
            ("mass_matrix", "mass_matrix_sensitivities"),
            ("Mass matrix, row by row.", "Mass matrix and its total derivative along seeds."),
            ["q", *w.p],
            ["M"],
            (w.start, *matrix),
            (
                *_resting(w),
                Own(udot),
                Zero(udot),
                Own(force),
                *_seeds_at_rest(w),
                Columns(udot, (w.mass_tangent,), (Take(M, force), Take(dM, dforce))),
            ),
        ),
        Procedure(
            "inverse_mass_matrix",
            "Inverse of the mass matrix in O(n^2), row by row.",
            w.of("q", *w.p),
            (inverse,),
            (*_factors(w), *inverted),
        ),
        *_solution(w),
    ]


SOLVE = run("solve_in", "balance_back")
"""Sweeps that solve ``M x = b`` for the right sides of all directions."""


def _resting(w: Shared) -> tuple[Step, ...]:
    return (w.start, w.at_rest, *run("kinematics"))


def _factors(w: Shared) -> tuple[Step, ...]:
    return (*_resting(w), *run("triangularize"), Check())


def _seeds_at_rest(w: Shared) -> tuple[Step, ...]:
    du, dforce = w.of("du", "dforce")
    return (Own(du), Zero(du), Own(dforce), *w.turns)


def _solution(w: Shared) -> list[Procedure]:
    """The solution of M x = b, and its derivative."""
    udot, force, dforce, b, x, dx, db, dudot = w.of("udot", "force", "dforce", "b", "x", "dx", "db", "dudot")
    right = b.tangent("b")
    values: tuple[Step, ...] = (*_factors(w), Single(SOLVE, ((right, b),), ((dudot, x),)))
    return w.pair(
        ("solve_mass", "solve_mass_sensitivities"),
        ("Solution of M x = b in O(n).", "Solution of M x = b and its total derivative along seeds."),
        ["q", *w.p, "b"],
        ["x"],
        values,
        (
            *values,
            Bind(udot, x),
            Own(force),
            *_seeds_at_rest(w),
            w.mass_tangent,
            Combine(dforce, (db,), (dforce,)),
            Bind(right, dforce),
            Bind(dudot, dx),
            *SOLVE,
        ),
    )


def inverse_dynamics(w: Shared) -> list[Procedure]:
    force, tau, dforce, dtau, dudot = w.of("force", "tau", "dforce", "dtau", "dudot")
    right, held = dudot.called("b"), dforce.called("held")
    less: tuple[Step, ...] = ()
    less_along: tuple[Step, ...] = (Combine(dforce, (held, dforce)),)
    if w.forces:
        less = (Zero(tau), JOINT_FORCES, Combine(force, (force,), (tau,)))
        less_along = (
            Zero(tau),
            Zero(dtau),
            JOINT_FORCES,
            JOINT_FORCES.tangents(),
            Combine(force, (force,), (tau,)),
            Combine(dforce, (held, dforce), (dtau,)),
        )
    begin: tuple[Step, ...] = (w.start, *w.applied, *run("kinematics"))
    return w.pair(
        ("inverse_dynamics", "inverse_dynamics_sensitivities"),
        (
            "Joint forces that udot requires in addition to the model's own.",
            "The joint forces of the inverse dynamics and their total derivative along seeds.",
        ),
        ["q", "u", "udot", *w.rest],
        ["force"],
        (*begin, *run("newton_euler_out", "newton_euler_in"), *less),
        (
            *begin,
            w.ground_tangent,
            *w.turns,
            *w.applied_tangents,
            *run("inverse_out", "force_tangents"),
            Own(held),
            Copy(held, dforce),
            Bind(right, dudot),
            *run("mass_out", "mass_in"),
            *less_along,
        ),
    )
