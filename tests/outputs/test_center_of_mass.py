"""Centre of mass of the system and of bodies."""

from __future__ import annotations

import numpy as np
import pytest
from measured import TREE, Seen, outputs_of, problems, some_axis
from random_models import random_state

from codegen.model import ModelError, parse_model
from codegen.model.model import Model, Output
from codegen.reference import DenseEngine, RecursiveEngine


def draw(rng: np.random.Generator, model: Model) -> list[Output]:
    found = [Output("center", "center_of_mass", axis=some_axis(rng, model))]
    defaults = {p.name: p.value for p in model.parameters}
    heavy = [k for k, b in enumerate(model.bodies) if b.mass.evaluate(defaults) > 0]
    some = tuple(int(k) for k in rng.choice(heavy, min(len(heavy), 3), replace=False))
    return [*found, Output("center_of_some", "center_of_mass", axis=some_axis(rng, model), bodies=some)]


@pytest.mark.parametrize("engine", [DenseEngine, RecursiveEngine])
def test_it_is_the_mean_of_the_mass_centers(engine: type) -> None:
    """Bodies on fixed joints count as they are, in a link or on the ground."""
    names = ("stand", "arm", "hand", "ring", "hull", "wheel")
    model = parse_model(TREE)
    at = {b.name: ", ".join(str(e) for e in b.com) for b in model.bodies}
    lines = [f"{n}_{i}: {{position: {{body: {n}, at: [{at[n]}]}}, axis: {i}}}" for n in names for i in "xyz"]
    lines += [f"all_{i}: {{center_of_mass: system, axis: {i}}}" for i in "xyz"]
    lines += [f"some_{i}: {{center_of_mass: [ring, stand, wheel], axis: {i}}}" for i in "xyz"]
    lines += [f"one_{i}: {{center_of_mass: [ring], axis: {i}}}" for i in "xyz"]
    model = parse_model(TREE + outputs_of("\n".join(lines)))
    state = random_state(np.random.default_rng(6), model)
    seen = Seen(engine(model), *state)
    p = dict(zip(model.parameter_names, state.p, strict=True))
    mass = {b.name: b.mass.evaluate(p) for b in model.bodies}
    for name, bodies in (("all", names), ("some", ("ring", "stand", "wheel")), ("one", ("ring",))):
        total = sum(mass[n] for n in bodies)
        expected = sum(mass[n] * seen.vector(n) for n in bodies) / total
        rates = sum(mass[n] * seen.rates(n) for n in bodies) / total
        assert np.abs(seen.vector(name) - expected).max() < 1e-14
        assert np.abs(seen.rates(name) - rates).max() < 1e-13


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("{center_of_mass: all, axis: x}", "'all'; system or a list of bodies, such as [hull, arm], is allowed"),
        ("{center_of_mass: [], axis: x}", "a list of 0; system or a list of bodies"),
        ("{center_of_mass: system}", "center_of_mass needs axis; add axis"),
        ("{center_of_mass: [arm, amr], axis: x}", "center_of_mass[1]: unknown body 'amr'; *did you mean 'arm'?"),
        ("{center_of_mass: [arm, arm], axis: x}", "center_of_mass[1]: a body that is already in the list"),
        ("{center_of_mass: [ground], axis: x}", "the ground, which has no mass; list each body once"),
    ],
)
def test_mistakes_are_told(entry: str, said: str) -> None:
    (found,) = problems(entry)
    assert all(part in found for part in said.split("*")), found


@pytest.mark.parametrize("entry", ["center_of_mass: system", "momentum: angular, about: center_of_mass"])
def test_a_system_without_mass_has_none(entry: str) -> None:
    wheel = (
        "model: m\nbodies:\n  a: {parent: ground, joint: {type: revolute, axis: x}, inertia: {xx: 1, yy: 1, zz: 1}}\n"
    )
    with pytest.raises(ModelError, match="no body has mass at the default parameters, so there is no centre of mass"):
        parse_model(wheel + f"outputs:\n  o: {{{entry}, axis: x}}\n")


def test_bodies_without_mass_are_told() -> None:
    light = TREE.replace("points:", "  light: {parent: arm, joint: {type: fixed}}\npoints:")
    with pytest.raises(ModelError, match="these bodies have no mass at the default parameters, so no centre of mass"):
        parse_model(light + outputs_of("o: {center_of_mass: [light], axis: x}"))
