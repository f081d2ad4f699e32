"""Random prescribed motion for any model: some of its scalar coordinates become functions of time, parameters and inputs."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from random_models import expression

from codegen.model.expressions import Expression
from codegen.model.model import Model, Output, joint_coordinates
from codegen.model.rates import rate, with_names_replaced


def with_prescribed(rng: np.random.Generator, model: Model, share: float = 0.4) -> Model:
    """The model with each of its coordinates that are no quaternions prescribed with this probability, one at least.

    Outputs tell the forces that this takes, and forces and outputs know the coordinates by the functions that they are.
    """
    names = [
        n for b in model.bodies if not b.joint.kind.quaternions for n in joint_coordinates(b.name, b.joint.type)[0]
    ]
    if not names:
        return model
    chosen = [n for n in names if rng.random() < share] or [str(rng.choice(names))]
    return prescribed(model, {n: expression(function(rng, model)) for n in chosen})


def function(rng: np.random.Generator, model: Model) -> str:
    """A function of time, parameters and inputs whose values and derivatives are of order one."""
    a, w, c = (round(float(x), 3) for x in rng.uniform(0.3, 1.2, 3))
    p = f"{a}*{rng.choice(model.parameter_names)}" if model.parameters else f"{a}"
    i = f"{w}*{rng.choice(model.inputs)}" if model.inputs else f"{w}"
    forms = [
        f"{p}*sin({w}*t) + {i}", f"{p} + {i}*t - {c}*t**2/3", f"{c}", f"{p}*tanh({i} + t)", f"{i}*exp(-{p}*t)",
        f"sqrt(1 + ({p}*t)**2) - 1", f"atan2({p} + t, 2 + {i}**2)", f"{p}**2*cos(t)/(2 + sin({w}*t))", f"log(1 + {p}*t**2)",
        f"asin(0.4*sin({p}*t))*{w} - {c}*atan(t)", f"{p}", f"({p} + 1)**(t/2)", f"{c}*cosh({w}*t/2) - {p}*abs(1 + t)",
    ]  # fmt: skip
    return forms[int(rng.integers(len(forms)))]


def prescribed(model: Model, motion: dict[str, Expression]) -> Model:
    """A model as a file would have made it with this motion, and outputs for all driving forces."""
    by = {f"q.{n}": e.tree for n, e in motion.items()} | {f"u.{n}": rate(e).tree for n, e in motion.items()}

    def known(value: Any) -> Any:
        if isinstance(value, Expression):
            return with_names_replaced(value, by)
        if isinstance(value, tuple):
            return tuple(map(known, value))
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            return dataclasses.replace(
                value, **{f.name: known(getattr(value, f.name)) for f in dataclasses.fields(value)}
            )
        return value

    forces, loads, outputs = (known(x) for x in (model.forces, model.loads, model.outputs))
    found = dataclasses.replace(
        model,
        motion=motion,
        forces=forces,
        loads=loads,
        initial_q={n: e for n, e in model.initial_q.items() if n not in motion},
        initial_u={n: e for n, e in model.initial_u.items() if n not in motion},
        independent=tuple(n for n in model.independent if n not in motion),
    )
    units = {x.name: model.bodies[x.body].joint.kind.coordinate_units[x.index] for x in found.prescribed}
    driving = tuple(
        Output(f"driving_{i}", "driving_force", choice=(n, "N" if unit == "m" else "N m"))
        for i, (n, unit) in enumerate(units.items())
    )
    return dataclasses.replace(found, outputs=(*outputs, *driving))
