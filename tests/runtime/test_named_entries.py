"""Names of sensitivities and the quantities that they denote, in motions and equilibria."""

from __future__ import annotations

import re
from typing import Any

import pytest

from codegen.runtime.standalone.calls.named_entries import Entry, Names, apart, look_up, look_up_all, seeds_by_name

NAMES = Names(("mass", "length"), ("motor", "brake"), ("a", "b", "c"), ("a", "b", "c"), ("a",), ("a", "c"))


@pytest.mark.parametrize(
    ("name", "entry"),
    [
        ("length", Entry("p", 1)), ("q0.a", Entry("q", 0)), ("u0.c", Entry("u", 2)), ("inputs.brake", Entry("inputs", 1)),
        ("inputs.brake[2]", Entry("inputs", 1, 2)),
    ],
)  # fmt: skip
def test_names_stand_for_entries(name: str, entry: Entry) -> None:
    assert look_up(NAMES, name, (3, 3)) == entry


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        (("mass", "mass"), "sensitivities contain a name twice: mass, mass"),
        ((4,), "sensitivities contain 4, expected names such as 'length' or 'q0.crank'"),
        (("q0.b",), "sensitivities: q0.b is dependent; name an independent one: a"),
        (("u0.b",), "sensitivities: u0.b is dependent; name an independent one: a, c"),
        (("inputs.motor[3]",), "sensitivities: inputs.motor[3]: the input has 3 values, counted from 0"),
        (("lenght",), "expected one of mass, length, q0.a, u0.a, u0.c, inputs.motor, inputs.brake; did you mean 'length'?"),
    ],
)  # fmt: skip
def test_others_are_refused(asked: tuple[Any, ...], message: str) -> None:
    with pytest.raises(ValueError, match=re.escape(message)):
        look_up_all(NAMES, asked, (3, 3))


def test_a_state_of_rest_has_whole_inputs_only() -> None:
    along = seeds_by_name(("inputs.brake", "mass"), NAMES.parameters, NAMES.inputs)
    assert along.p.tolist() == [[0.0, 0.0], [1.0, 0.0]]
    assert along.inputs.tolist() == [[0.0, 1.0], [0.0, 0.0]]
    for name in ("inputs.brake[0]", "q0.a"):
        with pytest.raises(
            ValueError, match=re.escape(f"{name!r} is not known; expected one of mass, length, inputs.motor")
        ):
            seeds_by_name(name, NAMES.parameters, NAMES.inputs)


def test_a_vector_stands_for_its_entries() -> None:
    names = Names(
        ("pin.x", "pin.y", "pin.z", "mass"), ("motor",), ("ball.e0", "ball.e1", "pinion", "a"), ("ball.wx", "ball.wy", "a"),
        ("ball.e1", "a"), ("ball.wx", "ball.wy"),
    )  # fmt: skip
    asked = ("mass", "pin", "q0.ball", "u0.ball", "pin.y", "inputs.motor", "q0.a", "q0.pin", "pi", 3)
    vector = ("pin.x", "pin.y", "pin.z")
    expected = ("mass", *vector, "q0.ball.e1", "u0.ball.wx", "u0.ball.wy", *asked[4:])
    assert apart(names, asked) == expected  # what stands for nothing stays, to be refused by its own name
    assert seeds_by_name("pin", names.parameters, names.inputs).names == vector
    with pytest.raises(ValueError, match=re.escape("sensitivities contain a name twice")):
        look_up_all(names, apart(names, ("pin.x", "pin")), (3,))
