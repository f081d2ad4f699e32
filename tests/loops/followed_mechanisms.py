"""Mechanisms with random lengths and poses, assembled along random paths and compared with motions in small steps."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from codegen.runtime import AssemblyError, SingularLoopError
from codegen.runtime.standalone.arrays import normalise

Array = np.ndarray

FINE = 1e-3
"""rad, or characteristic lengths: steps of the motion."""

_BAR = "mass: 1, inertia: {xx: 0.1, yy: 0.1, zz: 0.1}"
_FOUR_BAR = f"""\
  one: {{parent: ground, joint: {{type: revolute, axis: z}}, {_BAR}}}
  two: {{parent: one, joint: {{type: revolute, axis: z, at: [a, 0, 0]}}, {_BAR}}}
  three: {{parent: two, joint: {{type: revolute, axis: z, at: [b, 0, 0]}}, {_BAR}}}
"""
_PIN = "  pin: {joint: {type: revolute, axis: z}, from: {body: three, at: [c, 0, 0]}, to: {body: ground, at: [x1, y1, 0]}}\n"
_DYAD = f"""\
  four: {{parent: PARENT, joint: {{type: revolute, axis: z, at: [e, f, 0]}}, {_BAR}}}
  five: {{parent: four, joint: {{type: revolute, axis: z, at: [g, 0, 0]}}, {_BAR}}}
"""
_SECOND = "  second: {joint: {type: revolute, axis: z}, from: {body: five, at: [h, 0, 0]}, to: {body: ground, at: [x2, y2, 0]}}\n"
_LENGTHS = "parameters: {a: 0.3, b: 0.6, c: 0.5, x1: 0.5, y1: 0.1, e: 0.2, f: 0.3, g: 0.5, h: 0.6, x2: 0.7, y2: 0.2}\n"


def _six_bar(parent: str, independent: str) -> str:
    return (
        f"model: six_bar_{parent}_{independent}\n{_LENGTHS}bodies:\n{_FOUR_BAR}{_DYAD.replace('PARENT', parent)}"
        f"loops:\n{_PIN}{_SECOND}independent: [{independent}]\n"
        "initial: {q: {one: 0.9, two: -0.3, three: -1.8, four: 0.2, five: -1.2}}\n"
    )


MODELS = {
    "four_bar": f"model: four_bar\nparameters: {{a: 0.3, b: 0.6, c: 0.5, x1: 0.5, y1: 0.1}}\nbodies:\n{_FOUR_BAR}loops:\n{_PIN}"
    "independent: [one]\ninitial: {q: {one: 0.9, two: -0.3, three: -1.8}}\n",
    "slider_crank": f"""\
model: slider_crank
parameters: {{a: 0.3, b: 0.7, x1: 0.8, y1: 0.1}}
bodies:
  one: {{parent: ground, joint: {{type: revolute, axis: z}}, {_BAR}}}
  two: {{parent: one, joint: {{type: revolute, axis: z, at: [a, 0, 0]}}, {_BAR}}}
  piston: {{parent: ground, joint: {{type: prismatic, axis: x, at: [x1, y1, 0]}}, {_BAR}}}
loops:
  pin: {{joint: {{type: revolute, axis: z}}, from: {{body: two, at: [b, 0, 0]}}, to: piston}}
independent: [one]
initial: {{q: {{one: 0.9, two: -1.2}}}}
""",
    "watt": _six_bar("three", "one"),  # the dyad on the rocker
    "stephenson": _six_bar("two", "one"),  # the dyad on the coupler
    "triad": _six_bar("two", "five"),  # what closes are three links at once
    "rssr": f"""\
model: rssr
parameters: {{a: 0.3, b: 0.9, c: 0.5, x1: 0.6, y1: 0.1, z1: 0.5}}
bodies:
  one: {{parent: ground, joint: {{type: revolute, axis: z}}, {_BAR}}}
  rocker: {{parent: ground, joint: {{type: revolute, axis: x, at: [x1, y1, z1]}}, {_BAR}}}
loops:
  rod: {{joint: {{type: distance, length: b}}, from: {{body: one, at: [a, 0, 0]}}, to: {{body: rocker, at: [0, c, 0]}}}}
independent: [one]
initial: {{q: {{one: 0.5, rocker: 0.3}}}}
""",
}


class Way(NamedTuple):
    """A closed state, and the target of its independent coordinates."""

    q: Array
    p: Array
    wanted: Array


def random_way(rng: np.random.Generator, solver: Any) -> Way:
    """A closed state with random lengths and angles; faces on the ground are placed where the links need them."""
    p = solver.parameters
    names = list(solver.parameter_names)
    for name in names:
        p[names.index(name)] = rng.uniform(0.2, 1.0)
    q = rng.uniform(-np.pi, np.pi, solver.nq)
    at = dict(zip(names, p, strict=True))
    q_of = dict(zip(solver.coordinate_names, q, strict=True))

    def put(**places: float) -> None:
        for name, value in places.items():
            p[names.index(name)] = value

    if solver.name == "rssr":
        crank = at["a"] * np.array([np.cos(q_of["one"]), np.sin(q_of["one"]), 0.0])
        rocker = np.array([at["x1"], at["y1"], at["z1"]])
        rocker += at["c"] * np.array([0.0, np.cos(q_of["rocker"]), np.sin(q_of["rocker"])])
        put(b=float(np.linalg.norm(rocker - crank)))
        return _way(rng, solver, q, p)
    turned = np.cumsum([q_of[n] for n in ("one", "two", "three") if n in q_of])
    bars = [at[n] * np.exp(1j * t) for n, t in zip("abc", turned, strict=False)]
    tip = sum(bars)
    if solver.name == "slider_crank":
        put(x1=tip.real - q_of["piston"], y1=tip.imag)
        return _way(rng, solver, q, p)
    put(x1=tip.real, y1=tip.imag)
    if "four" in q_of:
        n = 1 if "two_" in solver.name else 2  # the body that carries the dyad
        start = sum(bars[:n]) + (at["e"] + 1j * at["f"]) * np.exp(1j * turned[n])
        angle = turned[n] + q_of["four"]
        tip = start + at["g"] * np.exp(1j * angle) + at["h"] * np.exp(1j * (angle + q_of["five"]))
        put(x2=tip.real, y2=tip.imag)
    return _way(rng, solver, q, p)


def way_of_initial(rng: np.random.Generator, solver: Any) -> Way:
    """A path from a model's initial state: angles and displacements change by up to 1 rad or 1 m, rotations about any axis."""
    q, _ = solver.initial
    own = [solver.coordinate_names.index(n) for n in solver.independent_names]
    to = q.copy()
    to[own] += rng.uniform(-1.0, 1.0, len(own))
    normalise(to, tuple(i for i, n in enumerate(solver.coordinate_names) if n.endswith(".qw")))
    return Way(q, solver.parameters, to[own])


def _way(rng: np.random.Generator, solver: Any, q: Array, p: Array) -> Way:
    own = [solver.coordinate_names.index(n) for n in solver.independent_names]
    return Way(q, p, q[own] + rng.uniform(-2.9, 2.9, len(own)))


def motion_along(solver: Any, way: Way) -> tuple[Array, float]:
    """Where a motion leads along the way: coordinates, and the part of the way at which its branch ends, 1 if it does not.

    Newton's plain method from state to state of fine steps, which are halved where dependents move by more than a few of them.
    """
    own = [solver.coordinate_names.index(n) for n in solver.independent_names]
    quaternions = tuple(i for i, n in enumerate(solver.coordinate_names) if n.endswith(".qw"))
    start = way.q[own]
    size = np.abs(way.wanted - start).max()
    q, s, full = way.q.copy(), 0.0, FINE / size
    h = full
    step_of, values = solver._functions["newton_step"], solver._target.compute
    while s < 1.0 and h > 1e-9 * full:
        to = min(1.0, s + h)
        trial = q.copy()
        trial[own] = start + to * (way.wanted - start)
        normalise(trial, quaternions)
        left = np.inf
        try:
            for _ in range(6):
                (step,) = values(step_of, {"q": trial, "p": way.p}, ())
                trial = trial + step
                normalise(trial, quaternions)
                left = np.abs(step).max()
                if left < 1e-13:
                    break
        except SingularLoopError:
            left = np.inf
        if left < 1e-9 and np.abs(trial - q).max() < 20.0 * FINE:
            q, s, h = trial, to, min(full, 2.0 * h)
        else:
            h *= 0.5
    return q, s


AMBIGUOUS = ("rssr",)
"""Mechanisms with fewer dependent coordinates than tell where a guess comes from: the same ones belong to two closed states."""


def compare(solver: Any, way: Way, follow: bool) -> str:
    """What comes of assembly beside the motion: ``same``, ``ended`` alike, or what differs.

    Either as a path of two states, or from the dependent coordinates of the first alone.
    """
    own = [solver.coordinate_names.index(n) for n in solver.independent_names]
    guess = way.q.copy()
    guess[own] = way.wanted
    expected, part = motion_along(solver, way)
    try:
        if follow:
            found = solver.assemble(np.stack([way.q, guess]), p=way.p, follow=True)[0][1]
        else:
            found = solver.assemble(guess, p=way.p)[0]
    except (AssemblyError, SingularLoopError) as error:
        return "ended" if part < 1.0 else f"not closed: {error}"
    if part < 1.0:
        return f"closed, but the motion ends at {part:.9f}"
    off = np.abs(found - expected).max()
    if off < 1e-7:
        return "same"
    turns = (found - expected) / (2.0 * np.pi)
    return f"{'wound' if np.abs(turns - np.round(turns)).max() < 1e-7 else 'other branch'}: off by {off:.3g}"
