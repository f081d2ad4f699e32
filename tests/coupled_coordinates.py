"""Random couplings of coordinates for any model, which its given state satisfies."""

from __future__ import annotations

import dataclasses

import numpy as np
from random_models import RandomState, expression, random_state, random_tree

from codegen.loops.errors import PartitionError
from codegen.loops.partition import partition
from codegen.model.model import Model, Term, coupling, joint_coordinates

Array = np.ndarray


def scalar_coordinates(model: Model) -> dict[str, tuple[int, int]]:
    """The coordinates that may be coupled: by name, the body and the index in its joint."""
    return {
        name: (k, i)
        for k, b in enumerate(model.bodies)
        if not b.joint.kind.quaternions
        for i, name in enumerate(joint_coordinates(b.name, b.joint.type)[0])
    }


def with_couplings(rng: np.random.Generator, model: Model, q: Array, p: Array, count: int) -> Model:
    """The model with a given number of couplings of two to four coordinates, with ratios and offsets of parameters, which q
    and p satisfy."""
    places, at = scalar_coordinates(model), dict(zip(model.parameter_names, p, strict=True))
    values = dict(zip(model.coordinate_names, q, strict=True))
    names, found, own = list(places), [], set()
    for n in range(count):
        free = [name for name in names if name not in own]
        if len(names) < 2 or not free:
            break
        first = str(rng.choice(free))
        own.add(first)
        others = [x for x in names if x != first]
        chosen = rng.choice(others, size=min(len(others), int(rng.integers(1, 4))), replace=False)
        terms, total = [Term(*places[first], expression(1))], values[first]
        for name in map(str, chosen):
            size = float(rng.choice([-1, 1]) * rng.uniform(0.3, 3))
            factor = expression(f"{size!r}*{rng.choice(model.parameter_names)}" if model.parameters else size)
            terms.append(Term(*places[name], factor))
            total += float(factor.evaluate(at)) * values[name]
        offset = f"{float(total)!r}"
        if model.parameters:
            name = str(rng.choice(model.parameter_names))
            offset = f"{float(total)!r} + 0.7*({name} - {float(at[name])!r})"
        found.append(coupling(f"gear{n}", tuple(terms), expression(offset)))
    return dataclasses.replace(model, loops=(*model.loops, *found))


def coupled_tree(
    rng: np.random.Generator, n: int, joints: tuple[str, ...], count: int
) -> tuple[Model, RandomState] | None:
    """A random tree with couplings and a state that satisfies them; None if nothing can be coupled."""
    tree = random_tree(rng, n, joints)
    state = random_state(rng, tree)
    model = with_couplings(rng, tree, state.q, state.p, count)
    if not model.loops:
        return None
    defaults = tuple(dataclasses.replace(x, value=float(v)) for x, v in zip(model.parameters, state.p, strict=True))
    initial = dict(zip(model.coordinate_names, map(expression, map(float, state.q)), strict=True))
    model = dataclasses.replace(model, parameters=defaults, initial_q=initial)
    try:
        partition(model)
    except PartitionError as error:
        # a joint with all its coordinates determined, or couplings that follow from each other
        if "no freedom left" in str(error) or "already determine" in str(error):
            return None
        raise
    return model, state
