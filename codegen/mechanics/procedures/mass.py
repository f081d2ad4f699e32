"""Mass matrix, solutions with it, and inverse dynamics: of trees."""

from __future__ import annotations

from ...program.procedure import (
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
    udot, force, du, dforce, b, x = w.of("udot", "force", "du", "dforce", "b", "x")
    dM, M, dx, db, dudot, inverse = w.of("dM", "M", "dx", "db", "dudot", "inverse_M")
    right = b.tangent("b")  # the sweeps that solve take right sides and give solutions per direction
    resting: tuple[Step, ...] = (w.start, w.at_rest, *run("kinematics"))
    factors: tuple[Step, ...] = (*resting, *run("triangularize"), Check())
    solve = run("solve_in", "balance_back")
    at_rest: tuple[Step, ...] = (Own(du), Zero(du), Own(dforce), *w.turns)
    one_by_one: tuple[Step, ...] = (
        Own(right),
        Zero(right),
        Own(dforce),
        Columns(right, run("mass_out", "mass_in"), (Take(M, dforce, symmetric=True),)),
    )
    all_at_once: tuple[Step, ...] = one_by_one
    inverse_one_by_one: tuple[Step, ...] = (
        Own(right),
        Zero(right),
        Own(dudot),
        Columns(right, solve, (Take(inverse, dudot, symmetric=True),)),
    )
    inverse_at_once: tuple[Step, ...] = inverse_one_by_one
    if columns.applies(w.system):
        all_at_once = (Together((*run("composite"), columns.mass(w)), one_by_one),)
        inverse_at_once = (Together((columns.inverse_mass(w),), inverse_one_by_one),)
    return [
        *w.pair(
            ("mass_matrix", "mass_matrix_sensitivities"),
            ("Mass matrix, row by row.", "Mass matrix and its total derivative along seeds."),
            ["q", *w.p],
            ["M"],
            (w.start, *all_at_once),
            (
                *resting,
                Own(udot),
                Zero(udot),
                Own(force),
                *at_rest,
                Columns(udot, (w.mass_tangent,), (Take(M, force), Take(dM, dforce))),
            ),
        ),
        Procedure(
            "inverse_mass_matrix",
            "Inverse of the mass matrix in O(n^2), row by row.",
            w.of("q", *w.p),
            (inverse,),
            (*factors, *inverse_at_once),
        ),
        *w.pair(
            ("solve_mass", "solve_mass_sensitivities"),
            ("Solution of M x = b in O(n).", "Solution of M x = b and its total derivative along seeds."),
            ["q", *w.p, "b"],
            ["x"],
            (*factors, Single(solve, ((right, b),), ((dudot, x),))),
            (
                *factors,
                Single(solve, ((right, b),), ((dudot, x),)),
                Bind(udot, x),
                Own(force),
                *at_rest,
                w.mass_tangent,
                Combine(dforce, (db,), (dforce,)),
                Bind(right, dforce),
                Bind(dudot, dx),
                *solve,
            ),
        ),
    ]


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
            "Joint forces that udot needs beside the model's own.",
            "Those forces and their total derivative along seeds.",
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
