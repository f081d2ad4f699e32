"""Features that a model does not use leave nothing in its package: no word in the code, no argument, no file.

For each thing that a model may have: words that it leaves in a package, none of which is in that of the same model without.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import Any, NamedTuple

import pytest

from codegen.model import parse_model
from codegen.pipeline import write_solver
from codegen.runtime.sections import carried_files

PLAIN = """
model: plain
bodies:
  a: {parent: ground, joint: {type: revolute, axis: y}, mass: 1.5, com: [0, 0, -0.4], inertia: {xx: 0.1, yy: 0.2, zz: 0.1}}
  b: {parent: a, joint: {type: revolute, axis: y, at: [0, 0, -1]}, mass: 1, com: [0.1, 0, -0.3],
    inertia: {xx: 0.1, yy: 0.2, zz: 0.1}}
  c: {parent: b, joint: {type: prismatic, axis: z, at: [0, 0, -1]}, mass: 1, inertia: {xx: 0.1, yy: 0.2, zz: 0.1}}
"""


class Feature(NamedTuple):
    """Something that a model may have.

    Attributes
    ----------
    more : str
        What is added to the model.
    words : str
        In its C, header or NumPy module, separated by blanks.
    manifest : str
        Keys, functions or arguments of functions in ``model.json``.
    files : str
        Of the package, with ``NAME`` for the model's, or of its run time; and methods of its solver, such as ``frames(``.
    options : mapping
        How it is generated.
    without : mapping
        How the model without is generated.
    """

    more: str
    words: str = ""
    manifest: str = ""
    files: str = ""
    options: Mapping[str, Any] = MappingProxyType({})
    without: Mapping[str, Any] = MappingProxyType({})


def force(element: str, more: str = "") -> str:
    return f"{more}forces:\n  f: {{{element}}}\n"


def floor(value: str, more: str = "") -> str:
    """A force of the floor that body c meets, and what its value reads."""
    return force(f"type: force, on: c, value: [0, 0, '{value}']", more)


PINNED = "loops: {pin: {joint: {type: inline, axis: y}, from: c, to: {body: ground, at: [0, 0, -2]}}}\n"
FEATURES = {
    "gravity": Feature("gravity: [0, 0, -9.81]\n", "9.81"),
    "parameters": Feature("parameters: {m: 2.0}\noutputs: {h: {position: {body: b, at: [m, 0, 0]}, axis: z}}\n", "*p", "p"),
    "inputs": Feature(force("type: joint, joint: a, value: pull", "inputs: [pull]\n"), "*inputs", "inputs"),
    "time": Feature(force("type: joint, joint: a, value: 0.4375*t"), "0.4375 joint_forces", "t"),
    "joint forces": Feature(force("type: joint, joint: a, value: -2*q.a"), "joint_forces"),
    "friction": Feature(force("type: friction, joint: a, coulomb: 2.375, velocity: 0.01"), "2.375 joint_forces"),
    "limits": Feature(force("type: limit, joint: a, upper: 1, stiffness: 99.5, width: 0.1"), "joint_forces"),
    "tables": Feature(
        force("type: joint, joint: a, value: soft(q.a)", "tables: {soft: {x: [0, 1], y: [0, 4.375], outside: constant}}\n"),
        "joint_forces 4.375",
    ),
    "jumps": Feature(force("type: joint, joint: a, value: 'if(q.a < 0, -7.25*q.a, 0)'"), "7.25"),
    "springs": Feature(force("type: spring, from: ground, to: c, stiffness: 3"), "spring applied_forces", "elements"),
    "bushings": Feature(
        force("type: bushing, from: ground, to: {body: c, at: [1, 0, 0]}, rotational_stiffness: [0, 2, 0]"),
        "bushing applied_forces", "elements singular_elements",
    ),
    "forces on bodies": Feature(force("type: force, on: c, value: [0, 0, 3]"), "applied_forces", "elements"),
    "contact": Feature(floor("8750*max(0, -position.c.z)"), "8750.0 applied_forces", "elements"),
    "units": Feature(floor("k*max(0, -position.c.z)", "parameters: {k: 8.75 kN/m}\n"), "N/m *p", "p"),
    "actuators": Feature(force("type: actuator, from: ground, to: c, force: 4"), "actuator", "elements"),
    "outputs": Feature(
        "outputs: {h: {position: c, axis: z}}\n", "outputs", "outputs output_sensitivities"
    ),
    "prescribed motion": Feature(
        "motion: {a: 0.3*sin(t)}\n", "prescribed", "driving_forces t", "driving_forces("
    ),
    "prescribed motion with branches": Feature(
        "motion: {a: '0.3*max(0, t - 1)**2'}\n", "prescribed", "driving_forces t branching_motion",
        "driving_forces( prescribed_branches.py kinks.py",
    ),
    "loops": Feature(
        f"{PINNED}initial: {{q: {{a: 0.3, b: 0.1}}}}\n", "closure ear", "closure completion condition closures",
        "loops.py loop_forces.py assembly.py newton.py",
    ),
    "distances": Feature(
        "loops: {rod: {joint: {type: distance, length: 1.5}, from: c, to: {body: ground, at: [0.5, 0, -3]}}}\n",
        "closure ear surface_share", "closure closures",
    ),
    "couplings": Feature("couplings: {gear: {joint: b, follows: a}}\n", "closure COUPLINGS", "couplings closures"),
    "initial values from parameters": Feature(
        "parameters: {start: 0.2}\ninitial: {q: {a: start}}\n", "initial", "initial_sensitivities"
    ),
    "equilibrium at the start": Feature("gravity: [0, 0, -9.81]\ninitial: {equilibrium: true}\n", "", "initial_at_rest"),
    "reactions": Feature("", "reaction", "reactions", "reactions.py reactions(", {"reactions": True}),
    "frames": Feature(
        "", "frames", "frames frame_sensitivities frame_accelerations", "frames.py frames( points(", {"frames": True}
    ),
    "motions and their events": Feature(
        "", "state_rates", "state_rates", "NAME_motion.c events.c run.py simulation.py trajectory.py",
        {"functions": ("simulate",)}, {"functions": ("accelerations",)},
    ),
}  # fmt: skip


class Made(NamedTuple):
    code: str
    manifest: frozenset[str]
    files: frozenset[str]


@cache
def made(more: str, **options: Any) -> Made:
    """The generated output: code, everything that the manifest names, files."""
    source = write_solver(parse_model(PLAIN + more), **options)
    code = "\n".join(text for _, text in sorted(source.files.items()))
    manifest = json.loads(json.dumps(source.manifest))
    named = set(manifest)
    for name, function in manifest["functions"].items():
        named |= {name, *function["arguments"], *function["results"]}
    carried = carried_files(manifest)
    files = {name.rpartition("/")[2] for name in carried} | set(source.files)
    files |= set(re.findall(r"^    def (\w+\()", carried["_runtime/solver.py"], re.MULTILINE))
    return Made(code, frozenset(named), frozenset(files))


def has(code: str, word: str) -> bool:
    return re.search(rf"(?<![A-Za-z0-9]){re.escape(word)}(?![A-Za-z0-9])", code) is not None


@pytest.mark.parametrize("name", FEATURES)
def test_what_is_not_used_leaves_nothing(name: str) -> None:
    feature = FEATURES[name]
    without, used = made("", **feature.without), made(feature.more, **feature.options)
    files = set(feature.files.replace("NAME", "plain").split())
    print(
        {w for w in feature.words.split() if not has(used.code, w)},
        {w for w in feature.words.split() if has(without.code, w)},
    )
    assert not [w for w in feature.words.split() if not has(used.code, w)], "words that the feature does not leave"
    assert not [w for w in feature.words.split() if has(without.code, w)]
    assert used.manifest.issuperset(feature.manifest.split()), set(feature.manifest.split()) - used.manifest
    assert without.manifest.isdisjoint(feature.manifest.split())
    assert used.files >= files, files - used.files
    assert without.files.isdisjoint(files)


WRITTEN_OUT = floor("8750*max(0, -position.c.z)")
ONLY_NAMES = {
    "named expressions": floor("8750*depth", "expressions: {depth: 'max(0, -position.c.z)'}\n"),
    "constants with units": floor("k*max(0, -position.c.z)", "constants: {k: 8.75 kN/m}\n"),
    "what nobody reads": "constants: {tilt: 3.375 deg}\nexpressions: {torque: 0.4375*q.a}\n"
    "tables: {soft: {x: [0, 1], y: [0, 4.375], outside: constant}}\npoints: {foot: {body: c, at: [0, 0, 2.875]}}\n"
    + WRITTEN_OUT,
}
"""The same model, with names for parts of it."""


@pytest.mark.parametrize("name", ONLY_NAMES)
def test_names_leave_nothing(name: str) -> None:
    """The package is that of the model in which everything is written out, byte for byte."""
    assert made(ONLY_NAMES[name]) == made(WRITTEN_OUT)
