"""The files of an MJCF model: checks before MuJoCo reads them, and the lines of their elements."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from ..model import ModelError
from ..model.errors import Problem
from ..model.positions import shortened
from .files import Files
from .robot import Place
from .xml_reading import Element, parse_xml, read_robot_file
from .xml_values import is_true, place_of

MAX_COMPILED: Final = 200_000
"""Largest number of elements of a model, including copies."""
MAX_CHAIN: Final = 50
MAX_PIXELS: Final = 100_000_000
MAX_SIZE: Final = 1_000_000
_FOLDERS: Final = {
    "mesh": ("meshdir", "assetdir"),
    "skin": ("meshdir", "assetdir"),
    "texture": ("texturedir", "assetdir"),
}
_COPIES: Final = {"replicate": 1, "composite": 3, "flexcomp": 3}
"""Elements that create ``count`` copies, each with the maximum number of values in ``count``."""


class MjcfFiles:
    """The files of an MJCF.

    Attributes
    ----------
    parts : list of (Element, str)
        Root elements of the file, of included files and of attached models, with the prefix of the names in them.

    Parameters
    ----------
    root : Element
    files : Files
        The files that may be read.

    Raises
    ------
    ModelError
        If a file may not be read, or the compiled model would be too large.
    """

    def __init__(self, root: Element, files: Files) -> None:
        self.files = files
        self.main = Path(root.file).resolve().parent
        self.root = root
        self.problems: list[Problem] = []
        self.parts: list[tuple[Element, str]] = []
        self.models: dict[str, Element] = {}
        self.parsed: dict[str, Element] = {}
        self.included: dict[int, Element] = {}
        self.weights: dict[int, int] = {}
        self.gather(root, "", ())
        self.folders = {
            key: {v for e in self.elements("compiler") if (v := e.attributes.get(key, ""))}
            for key in ("meshdir", "texturedir", "assetdir")
        }
        self.strips = any(is_true(e.attributes.get("strippath", "")) for e in self.elements("compiler"))
        for element in self.every():
            self.check(element)
        if self.weigh(root) > MAX_COMPILED and not self.problems:
            heaviest = max(self.elements(*_COPIES, "attach"), key=lambda e: self.weights.get(id(e), 0), default=root)
            message = f"the model would have more than {MAX_COMPILED} elements with its copies; make fewer copies"
            self.problems.append(heaviest.problem(message))
        if self.problems:
            raise ModelError(self.problems)

    def every(self) -> Iterator[Element]:
        """All elements of all files of the model."""
        seen = set()
        for part, _ in self.parts:
            if id(part) not in seen:
                seen.add(id(part))
                yield from _within(part)

    def used(self) -> Iterator[Element]:
        """All elements of all files, without elements in defaults; an included file is read at the place of its
        <include>."""
        attached = {id(model): model for model in self.models.values()}
        stack = [*reversed(attached.values()), self.root]
        while stack:
            element = stack.pop()
            if element.tag == "include" and (found := self.included.get(id(element))) is not None:
                stack.extend(reversed(found.children))
            elif element.tag != "default":
                yield element
                stack.extend(reversed(element.children))

    def listed(self, kind: str) -> list[Element]:
        """The children of all elements of a kind."""
        return [child for element in self.used() if element.tag == kind for child in element.children]

    def joints(self) -> list[Element]:
        """Joints in the order of the compiled model: the joints of a body precede those of its child bodies."""
        found: list[Element] = []
        stack = [e for e in self.used() if e.tag == "worldbody"][::-1]
        while stack:
            body = stack.pop()
            own, bodies, inner = [], [], list(reversed(body.children))
            while inner:
                element = inner.pop()
                if element.tag in ("joint", "freejoint"):
                    own.append(element)
                elif element.tag == "body":
                    bodies.append(element)
                elif element.tag in ("frame", "include"):
                    whole = self.included.get(id(element), element)
                    inner.extend(reversed(whole.children))
            found += own
            stack.extend(reversed(bodies))
        return found

    def elements(self, *tags: str) -> Iterator[Element]:
        """All elements with one of the given tags."""
        return (element for element in self.every() if element.tag in tags)

    def gather(self, root: Element, prefix: str, chain: tuple[str, ...]) -> None:
        """Adds the files that a file includes and the models that it attaches."""
        self.parts.append((root, prefix))
        if len(chain) > MAX_CHAIN:
            self.problems.append(root.problem(f"more than {MAX_CHAIN} files include each other; use fewer"))
            return
        attached: dict[str, str] = {}
        for element in _within(root):
            name = element.attributes.get("file", "")
            if element.tag == "include" and name:
                found = self.opened(element, name)
                if found is not None and found.file not in chain:
                    self.included[id(element)] = found
                    self.gather(found, prefix, (*chain, found.file))
            elif element.tag == "model" and name:
                found = self.opened(element, name)
                if found is not None and found.file not in chain:
                    own = element.attributes.get("name") or found.attributes.get("model") or Path(name).stem
                    self.models[own] = found
                    attached.setdefault(own, "")
        uses = [
            (e.attributes.get("model", ""), e.attributes.get("prefix", "")) for e in _within(root) if e.tag == "attach"
        ]
        for own in attached:
            for prefix_ in dict.fromkeys(p for m, p in uses if m == own) or {"": None}:
                if len(self.parts) < MAX_SIZE:
                    self.gather(self.models[own], prefix + prefix_, (*chain, self.models[own].file))

    def opened(self, element: Element, name: str) -> Element | None:
        """The root element of a file; None if the file cannot be parsed; MuJoCo reports this error."""
        for folder in (self.main, Path(element.file).resolve().parent):
            path = Path(os.path.join(folder, name))
            if not _exists(path):
                continue
            key = str(path.resolve())
            if key not in self.parsed:
                why = self.files.forbidden(path)
                if why is not None:
                    self.problems.append(element.problem(f"file {shortened(name)} of <{element.tag}> is {why}"))
                    return None
                try:
                    self.parsed[key] = parse_xml(read_robot_file(path), str(path))
                except ModelError as error:
                    self.problems += error.problems
                    return None
            return self.parsed[key]
        return None

    def check(self, element: Element) -> None:
        """Report files that may not be read, and sizes above the limits."""
        attributes = element.attributes
        for key, name in attributes.items():
            if key.startswith("file") and name and element.tag not in ("include", "model"):
                self.check_file(element, name)
        sizes = {"hfield": ("nrow", "ncol"), "texture": ("width", "height")}.get(element.tag, ())
        if sizes and math.prod(_whole(attributes.get(key, "1")) for key in sizes) > MAX_PIXELS:
            what = " x ".join(attributes.get(key, "1") for key in sizes)
            self.problems.append(element.problem(f"<{element.tag}> has {what} points; at most {MAX_PIXELS}"))
        keys = {"size": ("nuser", "nkey"), "numeric": ("size",), "mesh": ("params",)}.get(element.tag, ())
        for key, text in attributes.items():
            if keys and key.startswith(keys) and math.prod(map(_whole, text.split())) > MAX_SIZE:
                message = f"{key} of <{element.tag}> is {shortened(text)}; at most {MAX_SIZE} is allowed"
                self.problems.append(element.problem(message))

    def check_file(self, element: Element, name: str) -> None:
        """Check whether a file that MuJoCo would read may be read."""
        keys = _FOLDERS.get(element.tag, ("meshdir", "texturedir", "assetdir"))
        folders = ["", *(folder for key in keys for folder in sorted(self.folders[key]))]
        names = [name, os.path.basename(name.replace("\\", "/"))] if self.strips else [name]
        for base in dict.fromkeys((self.main, Path(element.file).resolve().parent)):
            for folder in folders:
                for text in names:
                    path = Path(os.path.join(base, folder, text))
                    if _exists(path) and (why := self.files.forbidden(path)) is not None:
                        self.problems.append(element.problem(f"file {shortened(name)} of <{element.tag}> is {why}"))
                        return

    def weigh(self, root: Element, chain: tuple[int, ...] = ()) -> int:
        """The number of elements of a file; what is copied or included counts each time. `weights` stores the number
        for each element with its content."""
        if id(root) in chain:
            return 0
        if id(root) in self.weights:
            return self.weights[id(root)]
        within = (*chain, id(root))
        for element in reversed(list(_within(root))):
            total = 1 + sum(self.weights[id(child)] for child in element.children)
            others = {
                "attach": self.models.get(element.attributes.get("model", "")),
                "include": self.included.get(id(element)),
            }
            other = others.get(element.tag)
            total += 0 if other is None else self.weigh(other, within)
            if element.tag in _COPIES:
                counts = element.attributes.get("count", "1").split()[: _COPIES[element.tag]]
                total *= max(1, math.prod(_whole(count) for count in counts))
            self.weights[id(element)] = total
        return self.weights[id(root)]

    def places(self) -> dict[tuple[str, str], Place]:
        """The places of named elements, by kind and by their names in the compiled model."""
        found: dict[tuple[str, str], Place] = {}
        for part, prefix in self.parts:
            stack = [(part, "")]
            while stack:
                element, above = stack.pop()
                kind = {"freejoint": "joint"}.get(element.tag, element.tag)
                kind = above if above in ("equality", "actuator", "tendon", "keyframe") else kind
                if above not in ("default", "sensor") and "name" in element.attributes:
                    found.setdefault((kind, prefix + element.attributes["name"]), place_of(element))
                stack.extend((child, element.tag) for child in reversed(element.children))
        return found

    def is_named(self) -> bool:
        """Whether any element of the model has a given name."""
        return any("model" in part.attributes for part, prefix in self.parts if part is self.root or not prefix)


def _within(root: Element) -> Iterator[Element]:
    stack = [root]
    while stack:
        element = stack.pop()
        yield element
        stack.extend(reversed(element.children))


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except (OSError, ValueError):
        return False


def _whole(text: str) -> int:
    """The integer in a text; 1 if the text is not an integer; MuJoCo reports this error."""
    try:
        value = float(text)
    except ValueError:
        return 1
    return int(min(max(value, 0.0), 1e18)) if math.isfinite(value) else 10**18
