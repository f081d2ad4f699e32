"""Reflected inertia of rotors for the joints of any model, drawn at random."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from random_models import expression

from codegen.model.entries import ZERO
from codegen.model.expressions import Expression
from codegen.model.model import Joint, Model


def with_rotors(rng: np.random.Generator, model: Model, share: float = 0.7) -> Model:
    """The model with random rotors in its joints, each with a given probability, at least one.

    Some depend on parameters, some are numbers; of a joint of several freedoms some have none.
    """
    may = [k for k, b in enumerate(model.bodies) if b.joint.kind.armature_units()]
    if not may:
        return model
    chosen = [k for k in may if rng.random() < share] or [int(rng.choice(may))]
    bodies = list(model.bodies)
    for k in chosen:
        joint = bodies[k].joint
        bodies[k] = dataclasses.replace(
            bodies[k], joint=dataclasses.replace(joint, armature=_armature(rng, model, joint))
        )
    return dataclasses.replace(model, bodies=tuple(bodies))


def with_rotors_at(rng: np.random.Generator, drawn: Any, share: float = 0.7) -> Any:
    """A mechanism of `random_mechanisms` with rotors, in its drawn state."""
    return drawn._replace(model=with_rotors(rng, drawn.model, share))


def _armature(rng: np.random.Generator, model: Model, joint: Joint) -> tuple[Expression, ...]:
    count, speeds = len(joint.kind.armature_units()), len(joint.kind.speeds)
    given = [_inertia(rng, model) for _ in range(count)]
    if count > 1 and rng.random() < 0.5:
        given[int(rng.integers(count))] = ZERO
    return tuple(given) * (speeds // count)


def _inertia(rng: np.random.Generator, model: Model) -> Expression:
    """A random inertia, from a thousandth of a body's to ten times it."""
    a = float(10 ** rng.uniform(-3, 0.5))
    if not model.parameters or rng.random() < 0.3:
        return expression(a)
    p, n = (rng.choice(model.parameter_names) for _ in range(2))
    forms = [f"{a!r}*{p}*{n}**2", f"{a!r}*{p}", f"{a!r}*exp({p} - {n})", f"{a!r}*(1 + 0.3*sin({p}))"]
    return expression(forms[int(rng.integers(len(forms)))])
