"""Variables of a functional mock-up unit: names, kinds, start values and dependencies, by value reference."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ...model.errors import ModelError
from ...model.model import Model
from ...runtime.standalone.motion.switches import switch_words
from .events import indicators


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable of an FMU; its value reference is its place in the list of all.

    Attributes
    ----------
    name : str
    kind : str
        ``time``, ``q``, ``u``, ``rate``, ``parameter``, ``input``, ``output`` or ``switch``.
    unit, description : str
        Empty if there is none.
    start : float or None
        Start value; None for variables that are computed.
    free : bool
        Whether an importer may leave the start value to the FMU, which then computes it from parameters.
    bounds : tuple of float or None
        Least and largest value.
    state : int or None
        Of a time derivative: the value reference of its state.
    """

    name: str
    kind: str
    unit: str = ""
    description: str = ""
    start: float | None = None
    free: bool = False
    bounds: tuple[float | None, float | None] = (None, None)
    state: int | None = None

    @property
    def causality(self) -> str:
        """The causality of the standard."""
        names = {"time": "independent", "rate": "local", "switch": "local", "q": "output", "u": "output"}
        return names.get(self.kind, self.kind)

    @property
    def initial(self) -> str | None:
        """The attribute ``initial`` of the standard; None where it is not allowed."""
        if self.kind == "time":
            return None
        return "calculated" if self.start is None else "approx" if self.free else "exact"


def variables(model: Model, manifest: Mapping[str, Any]) -> list[Variable]:
    """All variables, in the order of their value references, which `unit.h` states.

    Raises
    ------
    ModelError
        If two variables have the same name.
    """
    initial, computed = manifest["initial"], "initial" in manifest["functions"]
    found = [Variable("time", "time", "s", "simulation time")]
    states = []
    for kind, names, units, own in (
        ("q", model.coordinate_names, model.coordinate_units, manifest["independent_names"]),
        ("u", model.speed_names, model.speed_units, manifest["independent_speed_names"]),
    ):
        for name, unit, value in zip(names, units, initial[kind], strict=True):
            what = {"q": "coordinate", "u": "speed"}[kind]
            if name in own:
                states.append((len(found), f"{kind}.{name}", unit))
            at = float(value) if name in own else None
            found.append(Variable(f"{kind}.{name}", kind, unit, f"{what} {name}", at, computed and name in own))
    found += [
        Variable(f"der({name})", "rate", per_second(unit), f"time derivative of {name}", state=n)
        for n, name, unit in states
    ]
    found += [
        Variable(p.name, "parameter", words(p.unit), "design parameter", float(p.value), bounds=(p.min, p.max))
        for p in model.parameters
    ]
    found += [Variable(name, "input", start=0.0) for name in model.inputs]
    outputs = zip(model.outputs, model.output_units, strict=True)
    found += [Variable(o.name, "output", words(unit)) for o, unit in outputs]
    found += [
        Variable(f"event_indicator[{n + 1}]", "switch", description=switch_words(manifest, k))
        for n, k in enumerate(indicators(model, manifest))
    ]
    _refuse_twins(model, found)
    return found


def _refuse_twins(model: Model, found: Sequence[Variable]) -> None:
    seen: dict[str, Variable] = {}
    for x in found:
        other = seen.setdefault(x.name, x)
        if other is not x:
            kinds = "the independent variable" if other.kind == "time" else f"{other.causality} {other.name}"
            place = f"{x.kind}s.{x.name}" if x.kind in ("parameter", "output", "input") else model.name
            raise ModelError(
                [
                    model.problem(
                        place, f"an FMU needs a name for each variable, but {x.name!r} is also {kinds}; rename it"
                    )
                ]
            )


def words(unit: str) -> str:
    """A unit with single spaces."""
    return " ".join(unit.split())


def per_second(unit: str) -> str:
    """The unit of a time derivative."""
    if unit.endswith("/s"):
        return f"{unit}^2"
    return f"{unit}/s" if unit else "1/s"


class Dependencies:
    """Value references of the variables on which each variable depends, from the arguments of the generated functions.

    Parameters
    ----------
    model : Model
    manifest : dict
    found : sequence of Variable
    """

    def __init__(self, model: Model, manifest: Mapping[str, Any], found: Sequence[Variable]) -> None:
        self._functions: Mapping[str, Any] = manifest["functions"]
        self._found = found
        self._plain = model.coordinate_names == model.speed_names
        states = [x.state for x in found if x.state is not None]
        by_kind: dict[str, list[int]] = {"t": [0], "inputs": [], "q": [], "u": []}
        for n, x in enumerate(found):
            if x.kind == "input":
                by_kind["inputs"].append(n)
            elif n in states:
                by_kind[x.kind].append(n)
        self._known = by_kind

    def of(self, number: int) -> tuple[list[int], bool]:
        """Value references of the knowns, and whether the variable is a constant multiple of each of them."""
        x = self._found[number]
        if x.kind in ("q", "u") and x.start is not None:
            return [number], True
        if x.kind == "rate" and x.state is not None:
            of = self._found[x.state]
            if of.kind == "q" and self._plain:
                name = f"u.{of.name.partition('.')[2]}"
                speed = next((n for n in self._known["u"] if self._found[n].name == name), None)
                if speed is not None:
                    return [speed], True
            return self._of_arguments("coordinate_rates" if of.kind == "q" else "accelerations"), False
        name = {"q": "closing_step", "u": "completion", "output": "outputs", "switch": "switches"}[x.kind]
        return self._of_arguments(name), False

    def _of_arguments(self, function: str) -> list[int]:
        """The knowns that are arguments of a function, or arguments of the loop closure before the function is
        called."""
        closing = self._functions.get("closing_step", {"arguments": ()})["arguments"]
        own = self._functions.get(function, {"arguments": self._known})["arguments"]
        arguments: Iterable[str] = [*own, *closing]
        return sorted({n for a in arguments for n in self._known.get(a, ())})
