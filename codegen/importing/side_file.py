"""Side files: loops and couplings in the model format, for robot formats that lack them."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from ..model import ModelError
from ..model.errors import Problem, nearest
from ..model.positions import Document, compose, read_file
from .robot import Robot

_PLAIN: Final = re.compile(r"[A-Za-z0-9_.(+-][^,\[\]{}#&*!|>'\"%@`:?\n\t\\]*|[A-Za-z0-9_.(+-][A-Za-z0-9_.()+*/ -]*")
"""Texts that need no quotes in YAML."""
_PARTS: Final = re.compile(r"\[\d+\]|[^.\[]+")
"""Keys and indices of a path such as ``independent[1]``."""
SECTIONS: Final = ("points", "loops", "couplings", "loop_tolerance", "initial", "independent")


@dataclass(slots=True)
class SideFile:
    """Contents of a side file.

    Attributes
    ----------
    sections : dict of str to list of str
        Lines of each section.
    links : set of str
        Links that the file names; these links are not merged with other links.
    document : Document, optional
    """

    sections: dict[str, list[str]] = field(default_factory=dict)
    links: set[str] = field(default_factory=set)
    document: Document | None = None

    def problem(self, problem: Problem) -> Problem:
        """An error in the model, at its place in the side file."""
        assert self.document is not None
        parts = [int(part[1:-1]) if part[0] == "[" else part for part in _PARTS.findall(problem.path)]
        line, column = self.document.place(self.document.root, tuple(parts))
        return Problem(self.document.file, line, column, problem.path, problem.message, problem.severity)


def read_side_file(path: str | os.PathLike[str], robot: Robot, names: Mapping[str, str]) -> SideFile:
    """Read a side file. It names links as in the robot's file or in the model, and coordinates by their link or joint.

    Raises
    ------
    ModelError
        If the file is not YAML, has other sections, or names a coordinate twice.
    """
    file = os.fspath(path)
    document = compose(read_file(file), file)
    side = SideFile(document=document)
    problems = list(document.problems)
    root = document.root
    if not isinstance(root, dict) or ("loops" not in root and "couplings" not in root):
        problems.append(
            Problem(file, 1, 1, "", f"neither a section loops nor couplings; allowed are {', '.join(SECTIONS)}")
        )
        raise ModelError(problems)
    for key in root:
        if key not in SECTIONS:
            line, column = document.place(root, (key,), key=True)
            message = f"section {key!r} is not allowed here; {', '.join(SECTIONS)} are{nearest(key, SECTIONS)}"
            problems.append(Problem(file, line, column, "", message))
    if problems:
        raise ModelError(problems)
    new = {**{n: n for n in names.values()}, **names}
    by_new = {n: link for link, n in names.items()}
    for section in ("points", "loops"):
        for value in _mappings(root.get(section)):
            for key in ("body", "from", "to"):
                if isinstance(value.get(key), str) and value[key] in new:
                    value[key] = new[value[key]]
                    side.links.add(by_new[value[key]])
    coordinates = {joint.name: names[joint.child] for joint in robot.joints.values() if joint.child in names} | new
    problems += _rename_coordinates(document, coordinates)
    if problems:
        raise ModelError(problems)
    for key, value in root.items():
        if isinstance(value, dict):
            side.sections[key] = [f"{_flow(k)}: {_flow(v)}" for k, v in value.items()]
        elif isinstance(value, list):
            side.sections[key] = [f"- {_flow(v)}" for v in value]
        elif value is not None:
            side.sections[key] = [_flow(value)]
    return side


def _rename_coordinates(document: Document, new: Mapping[str, str]) -> list[Problem]:
    """Gives coordinates of couplings, of ``initial`` and of ``independent`` their names in the model; returns an error for
    each coordinate that has two entries."""
    root, problems = document.root, []

    def renamed(section: str, entries: dict[str, Any]) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for key, value in entries.items():
            name = _coordinate(key, new)
            if name in found:
                line, column = document.place(entries, (key,), key=True)
                message = f"{key!r} is the coordinate {name}, which has an entry already; give it once"
                problems.append(Problem(document.file, line, column, section, message))
            found[name] = value
        return found

    for value in _mappings(root.get("couplings")):
        if isinstance(value.get("joint"), str):
            value["joint"] = _coordinate(value["joint"], new)
        follows = value.get("follows")
        if isinstance(follows, dict):
            value["follows"] = renamed("couplings", follows)
        elif isinstance(follows, str):
            value["follows"] = _coordinate(follows, new)
    for key, value in initial.items() if isinstance(initial := root.get("initial"), dict) else ():
        if key in ("q", "u") and isinstance(value, dict):
            initial[key] = renamed(f"initial.{key}", value)
    if isinstance(independent := root.get("independent"), list):
        independent[:] = [_coordinate(name, new) for name in independent]
    return problems


def _coordinate(name: Any, new: Mapping[str, str]) -> Any:
    """The name of a coordinate in the model. In the side file, the part before the point may be the name of a link or
    joint in the robot's file, as in ``arm.1``."""
    if not isinstance(name, str) or name in new:
        return new.get(name, name)
    stem, dot, part = name.rpartition(".")
    return f"{new[stem]}.{part}" if dot and stem in new else name


def _mappings(value: Any) -> list[dict[str, Any]]:
    """All mappings that a value contains, itself included."""
    found, stack = [], [value]
    while stack:
        one = stack.pop()
        if isinstance(one, dict):
            found.append(one)
            stack.extend(one.values())
        elif isinstance(one, list):
            stack.extend(one)
    return found


def _flow(value: Any) -> str:
    """A value in YAML's flow style."""
    if isinstance(value, dict):
        return f"{{{', '.join(f'{_flow(k)}: {_flow(v)}' for k, v in value.items())}}}"
    if isinstance(value, list):
        return f"[{', '.join(map(_flow, value))}]"
    if value is None:
        return ""
    text = str(value)
    if _PLAIN.fullmatch(text) and text.strip() == text and not text.startswith("- "):
        return text
    for old, new in (("\\", "\\\\"), ('"', '\\"'), ("\n", "\\n"), ("\t", "\\t")):
        text = text.replace(old, new)
    return f'"{text}"'
