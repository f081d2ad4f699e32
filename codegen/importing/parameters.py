"""Numbers of a robot that become parameters of the model: ``arm:length,forearm:mass``."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Final

from ..model.errors import Problem, nearest
from ..model.joints import JOINTS
from ..model.positions import shortened
from .bodies import Bodies, ImportedBody
from .placement import Three
from .robot import WORLD, RobotJoint
from .words import number, vector

WORDS: Final = {
    "mass": "the mass; inertia and centre of mass stay",
    "com": "the three coordinates of the centre of mass",
    "inertia": "the six entries of the inertia matrix",
    "at": "the three coordinates of the joint that carries the body, in its parent",
    "length": "the distance to the joint of the only body that it carries, along a fixed line",
    "damping": "the damping of the joint that carries the body",
    "armature": "the reflected inertia of the rotors of the joint that carries the body",
}


def requested_words(requested: str | Mapping[str, Iterable[str] | str] | Iterable[str] | None) -> list[tuple[str, str]]:
    """Pairs of link and word, from a text ``arm:length,forearm:mass``, a list of such texts, or a mapping of links to words."""
    if requested is None:
        return []
    if isinstance(requested, Mapping):
        return [(k, w) for k, v in requested.items() for w in ([v] if isinstance(v, str) else v)]
    parts = requested.split(",") if isinstance(requested, str) else list(requested)
    pairs = []
    for part in filter(None, (p.strip() for p in parts)):
        link, _, word = part.rpartition(":")
        pairs.append((link.strip(), word.strip()))
    return pairs


class Parameters:
    """Collects the parameters of a model while its text is written."""

    def __init__(self) -> None:
        self._entries: dict[str, str] = {}
        self._lengths: dict[int, str] = {}

    def lines(self) -> list[str]:
        """The entries of the section ``parameters``."""
        return [f"{name}: {entry}" for name, entry in self._entries.items()]

    def _new(self, name: str, value: float, unit: str, least: float | None = None) -> str:
        bound = "" if least is None or value < least else f", min: {number(least)}"
        self._entries[name] = f"{{value: {number(value)}, unit: {unit}{bound}}}"
        return name

    def mass(self, body: str, value: float, words: set[str]) -> str:
        """The text of a mass: a number, or the name of a parameter."""
        return self._new(f"{body}_mass", value, "kg", 0.0) if "mass" in words else number(value)

    def com(self, body: str, value: Three, words: set[str]) -> str:
        """The text of a centre of mass: numbers, or names of parameters."""
        return self._three(f"{body}_com", value) if "com" in words else vector(value)

    def inertia(self, body: str, six: Mapping[str, float], words: set[str]) -> dict[str, str]:
        """The texts of the entries of an inertia: numbers, or names of parameters."""
        if "inertia" in words:
            return {key: self._new(f"{body}_i{key}", value, "kg m^2") for key, value in six.items()}
        return {key: number(value) for key, value in six.items() if value}

    def at(self, body: str, value: Three, words: set[str], parent: ImportedBody | None) -> str | None:
        """Text for a joint's position; None to use the position of the frame."""
        if "at" in words:
            return self._three(f"{body}_at", value)
        if parent is None or "length" not in parent.words:
            return None
        length = math.sqrt(sum(v * v for v in value))
        name = self._new(f"{self._lengths[id(parent)]}_length", length, "m", 0.0)
        along = [i for i in range(3) if value[i]]
        if len(along) == 1:
            sign = "-" if value[along[0]] < 0 else ""
            return f"[{', '.join(sign + name if i in along else '0' for i in range(3))}]"
        return f"[{', '.join(f'{number(v / length)}*{name}' if v else '0' for v in value)}]"

    def damping(self, body: str, joint: RobotJoint, words: set[str]) -> list[str]:
        """Names of the damping parameters: one for each degree of freedom if the values differ."""
        if "damping" not in words:
            return []
        unit = "N s/m" if joint.type == "prismatic" else "N m s/rad"
        return self._each(f"{body}_damping", [(law.damping, unit) for law in joint.laws])

    def armature(self, body: str, joint: RobotJoint, words: set[str]) -> list[str]:
        """Texts for the reflected rotor inertia; one for each coordinate, or one for a ball joint."""
        if "armature" not in words:
            return [number(a) for a in joint.armature]
        units = [unit for _, unit in JOINTS[joint.type].armature_units()]
        return self._each(f"{body}_armature", list(zip(joint.armature, units, strict=True)))

    def _each(self, name: str, rows: list[tuple[float, str]]) -> list[str]:
        """Parameters for non-negative numbers with their units; if there are several, their names are numbered."""
        ends = [f"_{i + 1}" for i in range(len(rows))] if len(rows) > 1 else [""]
        return [self._new(f"{name}{end}", value, unit, 0.0) for end, (value, unit) in zip(ends, rows, strict=True)]

    def _three(self, name: str, value: Three) -> str:
        return f"[{', '.join(self._new(f'{name}_{axis}', v, 'm') for axis, v in zip('xyz', value, strict=True))}]"

    def ask(self, pairs: list[tuple[str, str]], bodies: Bodies, names: Mapping[str, str], file: str) -> list[Problem]:
        """Mark the numbers that become parameters; returns the errors.

        Parameters
        ----------
        pairs : list of (str, str)
            Link, by its name in the file or in the model; and word.
        bodies : Bodies
        names : dict of str to str
            Names of the links in the model.
        file : str
            The robot's file, for messages.
        """
        found = []
        by_name = {names[link]: body for link, body in bodies.all.items()} | dict(bodies.all)
        for link, word in pairs:
            wrong = self._ask(link, word, by_name, bodies, names)
            if wrong is not None:
                found.append(Problem(file, None, None, f"--parameterize {link}{':' if link else ''}{word}", wrong))
        return found

    def _ask(
        self, link: str, word: str, known: Mapping[str, ImportedBody], bodies: Bodies, names: Mapping[str, str]
    ) -> str | None:
        body = known.get(link)
        if not link:
            return "lacks a link or a word; write LINK:WORD, such as arm:length"
        if word not in WORDS:
            return f"{shortened(word)} is not a number of a body; {', '.join(WORDS)} are{nearest(word, WORDS)}"
        if body is None:
            holder = bodies.holders.get(link)
            if holder is not None:
                where = "the ground" if holder[0] == WORLD else f"body {names[holder[0]]!r}"
                other = "" if holder[0] == WORLD else "name that body, or "
                return f"{shortened(link)} is fixed to {where}, so it is not a body; {other}use --keep-fixed"
            listed = list(dict.fromkeys(names[n] for n in bodies.all))
            shown = ", ".join(listed[:8]) + (", ..." if len(listed) > 8 else "")
            return f"{shortened(link)} is not a body; bodies are {shown}{nearest(link, known)}"
        if word == "length":
            children = bodies.children(body.link.name)
            if len(children) != 1:
                listed = [names[c.link.name] for c in children]
                carries = f"carries {', '.join(listed[:5])}" if children else "carries no body"
                instead = "; CHILD:at is the position of one joint" if children else ""
                return f"{link!r} {carries}; a length needs exactly one child body, whose joint it leads to{instead}"
            if not any(children[0].frame.at):
                child = names[children[0].link.name]
                return f"the joints of {child!r} and {link!r} coincide: the length is zero and has no direction"
            self._lengths[id(body)] = names[body.link.name]
        if word == "damping" and not any(law.damping for law in body.joint.laws):
            return f"the joint of {link!r} has no damping in this file"
        if word == "armature" and not body.joint.armature:
            return f"the joint of {link!r} has no armature in this file"
        body.words.add(word)
        return None
