"""Worlds and models of an SDF as scopes of names, with included files read.

A scope is a world or a model. It contains the names of its links, joints, frames and models; ``a::b`` is b in model a.
The names of a model included with ``merge="true"`` are in the including model, but the poses of the included model are
relative to its own frame.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from ..model import ModelError
from ..model.errors import Problem
from ..model.positions import shortened
from .files import Files
from .xml_reading import Element, parse_xml, read_robot_file
from .xml_values import is_true, place_of, version_of

MAX_NESTED: Final = 30
MAX_SCOPES: Final = 1000
NAMED: Final = ("link", "joint", "frame")
_INCLUDE: Final = {"uri", "name", "pose", "static", "placement_frame", "plugin", "merge"}


@dataclass(slots=True, eq=False)
class Scope:
    """A world or a model.

    Attributes
    ----------
    name : str
    element : Element
    version : tuple of int
        Version of the file that contains the element.
    parent : Scope or None
        Scope that contains the name; None for a world, and for a model outside worlds.
    home : Scope or None
        Scope to whose frame the pose is relative: the parent, or a model merged into the parent.
    pose : Element or None
    placement_frame : str
        The frame of the model that is at the pose.
    static : bool
    is_merged : bool
        Whether its names are in the parent.
    depth : int
        Number of models that contain it.
    items : dict of str to Item
        Links, joints and frames by name.
    models : dict of str to Scope
    """

    name: str
    element: Element
    version: tuple[int, int]
    parent: Scope | None = None
    home: Scope | None = None
    pose: Element | None = None
    placement_frame: str = ""
    static: bool = False
    is_merged: bool = False
    depth: int = 0
    items: dict[str, Item] = field(default_factory=dict)
    models: dict[str, Scope] = field(default_factory=dict)

    @property
    def is_world(self) -> bool:
        """Whether the scope is a world, or a file that has models only."""
        return self.element.tag != "model"

    @property
    def is_fixed(self) -> bool:
        """Whether the model is static, or is inside a static model."""
        return self.static or (self.parent is not None and self.parent.is_fixed)

    def known(self) -> list[str]:
        """Names that denote a frame in this scope."""
        return [*([] if self.is_world else ["__model__"]), *self.items, *self.models]

    def all(self) -> Iterator[tuple[str, Scope]]:
        """This scope and all nested scopes, each with the prefix of its names in this scope."""
        yield "", self
        for name, model in self.models.items():
            for prefix, scope in model.all():
                yield f"{name}::{prefix}", scope


@dataclass(frozen=True, slots=True, eq=False)
class Item:
    """A link, a joint or a frame.

    Attributes
    ----------
    name : str
    element : Element
    home : Scope
        Scope to whose axes its pose refers by default: the scope of its name, or a model merged into this scope.
    """

    name: str
    element: Element
    home: Scope


class Scopes:
    """Makes scopes from elements, and reads the files that they include.

    Parameters
    ----------
    files : Files
    wrong : callable
        Receives an element and an error message about it.
    problems : list of Problem
        Receives the errors in other files.
    left : callable
        Receives an element that is left out.
    """

    def __init__(
        self,
        files: Files,
        wrong: Callable[[Element, str], None],
        problems: list[Problem],
        left: Callable[[Element], None],
    ) -> None:
        self.files = files
        self.wrong = wrong
        self.problems = problems
        self.left = left
        self.count = 0
        self.read: dict[str, Element] = {}

    def world(self, element: Element, version: tuple[int, int]) -> Scope:
        """The scope of a world, or of a file that has models only."""
        scope = Scope(element.attributes.get("name", "").strip(), element, version)
        self.fill(scope, scope, element, ())
        return scope

    def fill(self, names: Scope, home: Scope, element: Element, chain: tuple[str, ...]) -> None:
        """Add the children of an element to a scope.

        Parameters
        ----------
        names : Scope
            Receives the names.
        home : Scope
            The same scope, or a model that is merged into it.
        element : Element
        chain : tuple of str
            Files from the robot's file to this one, each including the next.
        """
        for child in element.children:
            if child.tag == "model":
                self.model(names, home, child, home.version, chain)
            elif child.tag == "include":
                self.include(names, home, child, chain)
            elif child.tag in NAMED:
                name = self.new_name(child, names)
                if name is not None:
                    names.items[name] = Item(name, child, home)

    def new_name(self, element: Element, scope: Scope, given: str | None = None) -> str | None:
        """The name of an element if it is new in the scope; None after an error."""
        name = (given if given is not None else element.attributes.get("name", "")).strip()
        if not name:
            self.wrong(element, f'<{element.tag}> has no name; name="..." is needed')
            return None
        if "::" in name or name == "world" or re.fullmatch("__.*__", name):
            self.wrong(element, f"name {shortened(name)} is reserved in SDF; choose one without :: and __")
            return None
        other = scope.items.get(name) or scope.models.get(name)
        if other is not None:
            where = place_of(other.element)
            line = f"in line {where.line}" + (f" of {where.file}" if where.file != element.file else "")
            self.wrong(element, f"name {shortened(name)} is already used {line}; names in a model must differ")
            return None
        return name

    def model(
        self, names: Scope, home: Scope, element: Element, version: tuple[int, int], chain: tuple[str, ...],
        include: Element | None = None,
    ) -> None:  # fmt: skip
        """Add a model, in the file or included; the <include> overrides the model."""
        self.count += 1
        place = place_of(include or element)
        if self.count > MAX_SCOPES:
            raise ModelError([place.problem(f"more than {MAX_SCOPES} models; read a smaller part of the world")])
        if names.depth >= MAX_NESTED or len(chain) > MAX_NESTED:
            raise ModelError([place.problem(f"more than {MAX_NESTED} nested models; use fewer")])

        def said(tag: str) -> Element | None:
            own = include.first(tag) if include is not None else None
            return own if own is not None else element.first(tag)

        merged = include is not None and is_true(include.attributes.get("merge", ""))
        given = include.first("name") if include is not None else None
        frame = include.first("placement_frame") if include is not None else None
        static = said("static")
        scope = Scope(
            "", element, version, names, home, said("pose"),
            element.attributes.get("placement_frame", "").strip() if frame is None else frame.text.strip(),
            static is not None and is_true(static.text), merged,
            names.depth + 1,
        )  # fmt: skip
        if merged:
            self.fill(names, scope, element, chain)
            return
        own = element.attributes.get("name", "") if given is None else given.text
        name = self.new_name(include or element, names, own)
        if name is None:
            return
        scope.name = name
        names.models[name] = scope
        self.fill(scope, scope, element, chain)

    def include(self, names: Scope, home: Scope, include: Element, chain: tuple[str, ...]) -> None:
        """Add the model that an <include> names."""
        for child in include.children:
            if child.tag == "experimental:params":
                self.wrong(
                    child, "<experimental:params> modifies the included model and is not read; include a modified copy"
                )
            elif child.tag not in _INCLUDE:
                self.left(child)
        uri = include.first("uri")
        name = uri.text.strip() if uri is not None else ""
        found = self.opened(name, Path(include.file).resolve().parent)
        if isinstance(found, str):
            self.wrong(include, f"<include> of {shortened(name)}: {found}")
            return
        path = str(found.resolve())
        if path in chain:
            self.wrong(
                include, f"<include> of {shortened(name)}: files include each other in a circle; remove one include"
            )
            return
        try:
            root = self.read.get(path)
            if root is None:
                root = self.read[path] = parse_xml(read_robot_file(found), str(found))
        except ModelError as error:
            self.problems += error.problems
            return
        if root.tag != "sdf":
            self.wrong(include, f"<include> of {shortened(name)}: its root element is <{root.tag}>; give an SDF file")
            return
        models = list(root.all("model"))
        if not models:
            kinds = [child.tag for child in root.children if child.tag in ("actor", "light")]
            if kinds:
                self.left(include)
            else:
                self.wrong(include, f"<include> of {shortened(name)}: it has no <model>; one is needed")
            return
        if len(models) > 1:
            self.wrong(include, f"<include> of {shortened(name)}: it has {len(models)} models; one is needed")
            return
        self.model(names, home, models[0], version_of(root.attributes.get("version", "1.0")), (*chain, path), include)

    def opened(self, name: str, folder: Path) -> Path | str:
        """The file of a URI, or an error message."""
        path = self.files.find(name, folder)
        if path is None:
            return self.files.missing(name, folder) or "file not found"
        forbidden = self.files.forbidden(path)
        if forbidden is not None:
            return forbidden
        if path.is_dir():
            inner = self.of_folder(path)
            if inner is None:
                return "no .sdf in that folder"
            path = inner
            forbidden = self.files.forbidden(path)
        return path if forbidden is None else forbidden

    def of_folder(self, folder: Path) -> Path | None:
        """The model file in a folder: the newest version in model.config, otherwise model.sdf or any SDF file."""
        config = folder / "model.config"
        if config.is_file() and self.files.forbidden(config) is None:
            try:
                root = parse_xml(read_robot_file(config), str(config))
            except ModelError:
                root = None
            listed = list(root.all("sdf")) if root is not None else []
            for element in sorted(listed, key=lambda e: version_of(e.attributes.get("version", "1.0")), reverse=True):
                path = folder / element.text.strip()
                if element.text.strip() and path.is_file():
                    return path
        return next((p for p in (folder / "model.sdf", *sorted(folder.glob("*.sdf"))) if p.exists()), None)
