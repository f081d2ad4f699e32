"""Small models with or without each feature of model files; every pair of choices occurs together in at least one of them."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from itertools import combinations, product
from typing import NamedTuple

import numpy as np

Choices = dict[str, Sequence[str]]

MAY_HAVE: Choices = {
    "joint": ("revolute", "prismatic", "screw", "cylindrical", "planar", "universal", "spherical", "free"),
    "outputs": (
        "none",
        "position",
        "velocity",
        "distance",
        "value",
        "given",
        "acceleration",
        "switched",
        "kinetic",
        "potential",
        "momentum",
    ),
    "springs": ("none", "numbers", "parameters", "inputs", "time"),
    "forces": ("none", "state", "inputs", "time", "switched", "on bodies"),
    "gravity": ("none", "numbers", "parameters"),
    "bodies": ("moving", "one fixed", "one massless"),
    "parameters": ("none", "some"),
    "initial": ("numbers", "parameters"),
    "layout": ("kinds", "unrolled"),
    "reactions": ("no", "yes"),
}
"""Choices for every model. Where there are no parameters, their names are those of constants."""

LOOP_JOINTS_MAY_BE = ("fixed", "revolute", "prismatic", "universal", "spherical", "cylindrical", "planar", "inline")
TREES: Choices = MAY_HAVE
LOOPS: Choices = {"loop": LOOP_JOINTS_MAY_BE, **MAY_HAVE, "partitions": ("1", "2")}

TOGETHER = ("none", "position velocity distance switched", "value given acceleration", "kinetic potential momentum")
"""Outputs where few models are wanted: several in one model."""

ALIKE = {
    "loop": (LOOP_JOINTS_MAY_BE,),
    "joint": (("revolute", "prismatic", "screw"), ("universal", "cylindrical", "planar"), ("spherical", "free")),
    "springs": (("none",), ("numbers", "parameters"), ("inputs", "time")),
    "forces": (("none",), ("state", "inputs", "time", "switched"), ("on bodies",)),
    "gravity": (("none",), ("numbers", "parameters")),
    "bodies": (("moving",), ("one fixed", "one massless")),
}
"""Entries that the generated code treats nearly alike: where few models are wanted, they take turns."""

JOINTS = {
    "revolute": "{type: revolute, axis: [1, 0, 2]",
    "prismatic": "{type: prismatic, axis: -x",
    "screw": "{type: screw, axis: [1, 0, 2], pitch: 0.1*l",
    "cylindrical": "{type: cylindrical, axis: [1, 0, 2]",
    "planar": "{type: planar, normal: y",
    "universal": "{type: universal, axes: [y, x]",
    "spherical": "{type: spherical",
    "free": "{type: free",
}
LOOP_JOINTS = {
    "fixed": "{type: fixed}",
    "revolute": "{type: revolute, axis: y}",
    "prismatic": "{type: prismatic, axis: z}",
    "universal": "{type: universal, axes: [y, x]}",
    "spherical": "{type: spherical}",
    "cylindrical": "{type: cylindrical, axis: y}",
    "planar": "{type: planar, normal: x}",
    "inline": "{type: inline, axis: y}",
}
MEASURES = {
    "position": "{position: {body: tool, at: [0.1, 0, l]}, axis: [1, 0, 1]}",
    "velocity": "{velocity: {body: tool, at: [0, l, 0]}, axis: z}",
    "acceleration": "{acceleration: {body: tool, at: [0.1, 0, l]}, axis: [0, m, 1]}",
    "distance": "{distance: [{body: tool, at: [l, 0, 0.1]}, ground]}",
    "value": "{value: q.link_1*u.link_1 - l}",
    "kinetic": "kinetic_energy",
    "potential": "potential_energy",
    "momentum": "{momentum: angular, axis: y, about: center_of_mass}",
    "given": "{value: motor*sin(t)*u.link_1}",
    "switched": "{value: 'max(q.link_1, l)*abs(u.link_1)'}",
}
SPRINGS = {
    "numbers": ("20", "0.5", "0.6"),
    "parameters": ("k", "0.03*k", "l"),
    "inputs": ("20*(1 + pull**2)", "0.5*cos(pull)", "0.6 + 0.1*pull"),
    "time": ("20*(1 + t**2)", "0.5*cos(t)", "0.6 + 0.1*t"),
}
"""Stiffness, damping and free length."""
FORCES = {
    "state": "-0.3*q.link_1 - 0.1*u.link_1*m",
    "inputs": "motor - 0.1*u.link_1",
    "time": "sin(3*t)*m",
    "switched": "-k*max(q.link_1 - l, 0) - 0.1*abs(u.link_1)*u.link_1",
}
ON_BODIES = (
    "push: {type: force, on: {body: tool, at: [0.1, 0, l]}, value: [motor, -position.link_1.z, m]}",
    "turn: {type: torque, on: tool, value: [0.1, 0.2*u.link_1, 0.1*k], axes: body}",
    "coil: {type: torsion, from: ground, to: tool, axis: y, stiffness: 0.1*k, damping: 0.02}",
    "ram: {type: actuator, from: {body: ground, at: [1.1, 0.4, 0.2]}, to: tool, force: motor - velocity.tool.x}",
)
ANGLES = (0.5, 0.7, 0.4, 0.6)
"""Of the links at the start."""


class Mixture(NamedTuple):
    """The text of a model, its features, and the options of its generation."""

    name: str
    choice: dict[str, str]
    text: str
    options: dict[str, object]

    def has(self, what: str) -> bool:
        """Whether the model has a feature, given by the name of its choice."""
        return self.choice.get(what, "none") not in ("none", "no")


def mixtures(every: bool = False) -> list[Mixture]:
    """Trees, then mechanisms with a loop, in which every entry, and every pair of entries of different kinds, occurs.

    Parameters
    ----------
    every : bool
        Every two, whether alike or not, and each output alone: three times as many models.
    """
    found = []
    for kind, choices in (("tree", TREES), ("loop", LOOPS)):
        few = choices | {"outputs": TOGETHER}
        for i, choice in enumerate(covering(choices) if every else _taking_turns(few)):
            name = f"{kind}_{i}"
            options = {
                "layout": choice["layout"],
                "reactions": choice["reactions"] == "yes",
                "partitions": int(choice.get("partitions", "1")),
            }
            found.append(Mixture(name, choice, text(name, choice), options))
    return found


def covering(choices: Choices) -> list[dict[str, str]]:
    """A small number of rows, each with one entry for every choice, in which every pair of entries occurs together."""
    names = list(choices)
    missing = {
        tuple(zip(chosen, entries, strict=True)): None
        for chosen in combinations(names, 2)
        for entries in product(*(choices[n] for n in chosen))
    }
    rows = []
    while missing:
        row = dict(next(iter(missing)))
        for n in names:
            if n not in row:  # entries that gain alike take turns
                gains = {e: _gain(row, n, e, names, missing) for e in _turned(choices[n], len(rows))}
                row[n] = max(gains, key=gains.__getitem__)
        rows.append({n: row[n] for n in names})
        for pair in combinations(rows[-1].items(), 2):
            missing.pop(pair, None)
    return rows


def _gain(row: Mapping[str, str], name: str, entry: str, names: Sequence[str], missing: Container[object]) -> int:
    """The number of missing pairs that an entry adds to an incomplete row."""
    at = names.index(name)
    pairs = (((n, row[n]), (name, entry)) for n in names[:at] if n in row)
    later = (((name, entry), (n, row[n])) for n in names[at + 1 :] if n in row)
    return sum(pair in missing for pair in (*pairs, *later))


def _taking_turns(choices: Choices) -> list[dict[str, str]]:
    """Rows in which all entries occur, and every pair of entries of different kinds."""
    groups = {n: ALIKE.get(n, tuple((e,) for e in entries)) for n, entries in choices.items()}
    rows = []
    for row in covering({n: [str(i) for i in range(len(g))] for n, g in groups.items()}):
        rows.append({})
        for n, i in row.items():
            group = groups[n][int(i)]
            before = [r[n] for r in rows[:-1]]
            rows[-1][n] = min(group, key=before.count)
    missed = {n: set(entries) - {r[n] for r in rows} for n, entries in choices.items()}
    assert not any(missed.values()), missed
    return rows


def _turned(entries: Sequence[str], by: int) -> list[str]:
    by %= len(entries)
    return [*entries[by:], *entries[:by]]


def text(name: str, choice: Mapping[str, str]) -> str:
    """The model file: a chain of links in the x-z plane, with or without a loop that closes it, and a tool on one link."""
    closed = "loop" in choice
    links = 4 if closed else {"kinds": 3, "unrolled": 1}[choice["layout"]]
    on_bodies = ON_BODIES if choice["forces"] == "on bodies" else ()
    measured = {} if choice["outputs"] == "none" else {n: MEASURES[n] for n in choice["outputs"].split()}
    given = " ".join(
        [
            *on_bodies,
            *SPRINGS.get(choice["springs"], ()),
            FORCES.get(choice["forces"], ""),
            *measured.values(),
        ]
    )
    inputs = [n for n in ("motor", "pull") if n in given]
    gravity = {"none": "", "numbers": "gravity: [0.5, 0, -9.81]", "parameters": "gravity: [0.1*g, m, -g]"}
    lines = [
        f"model: {name}",
        gravity[choice["gravity"]],
        f"{'parameters' if choice['parameters'] == 'some' else 'constants'}: {{l: 0.4, m: 1.2, g: 9.81, k: 18.0}}",
        f"inputs: [{', '.join(inputs)}]" if inputs else "",
        "bodies:",
        f"  repeat i in 1..{links}:",
        "    link(i):",
        "      {parent: link(i-1), joint: {type: revolute, axis: y, at: [0, 0, l]}, mass: m, com: [0.03, 0.02, l/2],",
        "       inertia: {xx: 0.02*m, yy: 0.03*m, zz: 0.02, xz: 0.002}, first: {parent: ground, joint: {at: [0, 0, 0]}}}",
    ]
    carrier = f"link_{min(links, 2)}"
    if choice["bodies"] == "one massless":
        lines.append(f"  hinge: {{parent: {carrier}, joint: {{type: revolute, axis: x, at: [l/2, 0, 0]}}}}")
        carrier = "hinge"
        if choice["joint"] == "free":  # which passes no inertia on
            lines.append("  rod: {parent: hinge, joint: {type: prismatic, axis: z}, mass: m, com: [0, 0.2, l]}")
    lines.append(
        f"  tool: {{parent: {carrier}, joint: {JOINTS[choice['joint']]}, at: [0, 0.1, l]}}, mass: 0.7*m, com: [0.05, 0, 0.1],"
        " inertia: {xx: 0.02, yy: 0.03, zz: 0.01*m}}"
    )
    if choice["bodies"] == "one fixed":
        lines.append(
            "  plate: {parent: tool, joint: {type: fixed, at: [0, l/2, 0.1], rotate: [{axis: y, angle: l}]}, mass: 0.2,"
            " com: [0.1, 0, 0], inertia: {xx: 0.01, yy: 0.01, zz: 0.02}}"
        )
    if closed:
        turned = np.cumsum(ANGLES)
        x, z = float(np.sum(np.sin(turned))), float(np.sum(np.cos(turned)))
        lines += [
            "loops:",
            f"  ring: {{joint: {LOOP_JOINTS[choice['loop']]}, from: {{body: link_4, at: [0, 0, l]}},",
            f"         to: {{body: ground, at: [{x!r}*l, 0, {z!r}*l], rotate: [{{axis: y, angle: {float(turned[-1])!r}}}]}}}}",
        ]
    forces = []
    forces += [f"  {line}" for line in on_bodies]
    if choice["forces"] in FORCES:
        forces.append(f'  drive: {{type: joint, joint: link_1, value: "{FORCES[choice["forces"]]}"}}')
    if choice["springs"] != "none":
        stiffness, damping, free_length = SPRINGS[choice["springs"]]
        forces += [
            "  spring: {type: spring, from: {body: tool, at: [0.1, 0, l/2]}, to: {body: ground, at: [1.1, 0.4, 0.2]},",
            f"           stiffness: {stiffness}, damping: {damping}, free_length: {free_length}}}",
        ]
    lines += ["forces:", *forces] if forces else []
    angles = [f"link_{i + 1}: {a}" for i, a in enumerate(ANGLES[:links])]
    speed = {"numbers": "0.3", "parameters": "0.3*m"}[choice["initial"]]
    lines.append(f"initial: {{q: {{{', '.join(angles)}}}, u: {{link_1: {speed}}}}}")
    if measured:
        lines.append(f"outputs: {{{', '.join(f'{n}: {m}' for n, m in measured.items())}}}")
    return "\n".join(filter(None, lines)) + "\n"
