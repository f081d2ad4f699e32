"""Random prescribed motion for any model: some of its scalar coordinates become functions of time, parameters and inputs."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from random_models import expression

from codegen.loops.partition import partition
from codegen.model import parse_model
from codegen.model.expressions import Expression
from codegen.model.model import Model, Output, joint_coordinates
from codegen.model.rates import rate, with_names_replaced

BARS = """
model: bars
gravity: [0, 0, -9.81]
parameters: {length: 1.0, w: 2.0, a: 0.3}
bodies:
BASE
  crank:
    parent: FRAME
    joint: {type: revolute, axis: y}
    shape: &bar {type: cylinder, axis: z, length: length, radius: 0.02, mass: 0.8, center: [0, 0, length/2]}
  coupler: {parent: crank, joint: {type: revolute, axis: y, at: [0, 0, length]}, shape: *bar}
  rocker: {parent: coupler, joint: {type: revolute, axis: y, at: [0, 0, length]}, shape: *bar}
LOAD
loops:
  foot:
    joint: {type: revolute, axis: y}
    from: {body: rocker, at: [0, 0, length]}
    to: {body: FRAME, at: [1.2*length, 0, 0]}
MOTION
forces:
  seal: {type: joint, joint: rocker, value: -0.3*u.rocker + 0.1*t}
  bearing: {type: joint, joint: crank, value: CRANK}
initial:
  q: {coupler: 1.27, rocker: 1.87}
outputs:
  kinetic: kinetic_energy
  potential: potential_energy
"""
LOAD = "  load: {parent: coupler, joint: {type: revolute, axis: y, at: [0, 0, length/2]}, shape: *bar}"
DRIVEN = "motion: {crank: 0.3 + a*sin(w*t)}"


def bars(frame: str = "ground", load: bool = False, motion: str = DRIVEN, crank: str = "-0.3*u.crank") -> Model:
    """A four-bar with a driven crank, on the ground or on a ``cart``, with or without a pendulum on its coupler."""
    base = "  cart: {parent: ground, joint: {type: prismatic, axis: x}, mass: 3, inertia: {yy: 0.2}}"
    text = (
        BARS.replace("BASE\n", f"{base}\n" if frame == "cart" else "").replace("FRAME", frame).replace("MOTION", motion)
    )
    text = text.replace("CRANK", crank)
    return parse_model(text.replace("LOAD\n", f"{LOAD}\n" if load else ""))


def with_prescribed(rng: np.random.Generator, model: Model, share: float = 0.4) -> Model:
    """The model with each coordinate outside quaternions prescribed with a given probability, at least one of them."""
    names = [
        n for b in model.bodies if not b.joint.kind.quaternions for n in joint_coordinates(b.name, b.joint.type)[0]
    ]
    if not names:
        return model
    chosen = [n for n in names if rng.random() < share] or [str(rng.choice(names))]
    return prescribed(model, {n: expression(function(rng, model)) for n in chosen})


def with_prescribed_at(rng: np.random.Generator, drawn: Any, share: float = 0.5) -> Any:
    """A mechanism of `random_mechanisms` with some independent coordinates prescribed, in its drawn state."""
    model = drawn.model
    at = dict(zip(model.parameter_names, drawn.p, strict=True)) | {"t": drawn.t}
    at |= dict(zip(model.inputs, drawn.inputs, strict=True))
    names, place = [], {n: i for i, n in enumerate(model.coordinate_names)}
    free = {model.speed_names[i] for i in partition(model).independent}
    for b in model.bodies:
        if not b.joint.kind.quaternions:
            names += [n for n in joint_coordinates(b.name, b.joint.type)[0] if n in free]
    if not names:
        return None
    motion = {}
    for n in [n for n in names if rng.random() < share] or [str(rng.choice(names))]:
        e = expression(function(rng, model))
        motion[n] = expression(f"{e} + ({float(drawn.q[place[n]] - e.evaluate(at))!r})")
    found = prescribed(model, motion)
    q = [x for n, x in zip(model.coordinate_names, drawn.q, strict=True) if n not in motion]
    u = [x for n, x in zip(model.speed_names, drawn.u, strict=True) if n not in motion]
    rates = rng.uniform(-1, 1, len(found.inputs) - len(model.inputs))  # of inputs that the motion reads
    return drawn._replace(model=found, q=np.array(q), u=np.array(u), inputs=np.concatenate([drawn.inputs, rates]))


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
    """The model that a file with this motion gives, with outputs for all driving forces."""
    moving = frozenset(model.inputs)
    by = {f"q.{n}": e.tree for n, e in motion.items()}
    by |= {f"u.{n}": rate(e, moving=moving).tree for n, e in motion.items()}

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


def driven_crank(turn: str, speed: float, *, inputs: str = "", bodies: str = "", forces: str = "") -> str:
    """A slider-crank whose crank follows an expression that may contain the parameter `w`; `more` has further entries."""
    return f"""
model: driven_crank
parameters: {{r: 0.05, rod: 0.17, w: {speed}}}
inputs: [{inputs}]
bodies:
  crank: {{parent: ground, joint: {{type: revolute, axis: y}}, mass: 1, com: [0, 0, r/3],
    inertia: {{xx: 0.01, yy: 0.01, zz: 0.01}}}}
  rod: {{parent: crank, joint: {{type: revolute, axis: y, at: [0, 0, r]}}, mass: 0.5, com: [0, 0, rod/2],
    inertia: {{xx: 0.001, yy: 0.001, zz: 1e-4}}}}
  piston: {{parent: ground, joint: {{type: prismatic, axis: z}}, mass: 0.4}}
{bodies}
loops:
  pin: {{joint: {{type: revolute, axis: y}}, from: {{body: rod, at: [0, 0, rod]}}, to: piston}}
motion: {{crank: "{turn}"}}
forces: {{{forces}}}
initial: {{q: {{piston: rod + r}}}}
outputs: {{x: {{value: q.piston}}, torque: {{driving_force: crank}}}}
"""
