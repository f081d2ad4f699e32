"""XML to elements that remember their lines; nothing but elements, attributes and text is read.

A parser of our own over expat, since those of the standard library drop the lines. Entities that a file declares and
documents that it refers to are refused, so no file can blow up in memory or read another one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final
from xml.parsers import expat

from ..model import ModelError
from ..model.errors import Problem, within_a_line
from ..model.file_bytes import read_bytes

MAX_BYTES: Final = 64 * 2**20
MAX_ELEMENTS: Final = 1_000_000
MAX_DEPTH: Final = 100

_NEEDED: Final = "a URDF, MJCF or SDF file is needed"


@dataclass(slots=True)
class Element:
    """An element of an XML file.

    Attributes
    ----------
    tag : str
    attributes : dict of str to str
    line, column : int
        Where it begins, counted from 1.
    file : str
        As messages name it.
    children : list of Element
    text : str
        All text directly in it.
    """

    tag: str
    attributes: dict[str, str]
    line: int
    column: int
    file: str
    children: list[Element] = field(default_factory=list)
    text: str = ""

    def all(self, *tags: str) -> Iterator[Element]:
        """Its children of these tags."""
        return (c for c in self.children if c.tag in tags)

    def first(self, tag: str) -> Element | None:
        """Its first child of this tag."""
        return next(self.all(tag), None)

    def problem(self, message: str, severity: str = "error") -> Problem:
        """Something wrong here."""
        return Problem(self.file, self.line, self.column, "", within_a_line(message), severity)


def read_robot_file(path: str | Path) -> bytes:
    """The bytes of a robot's file.

    Raises
    ------
    ModelError
        If it cannot be read, is empty or too large.
    """
    data = read_bytes(path, MAX_BYTES, _NEEDED, "robots have far less")
    if not data.strip():
        raise ModelError([Problem(str(path), 1, 1, "", f"the file is empty; {_NEEDED}")])
    return data


def parse_xml(data: bytes | str, file: str) -> Element:
    """The root of an XML text.

    Raises
    ------
    ModelError
        If it is no XML, declares entities, or goes beyond every robot.
    """
    builder = _Builder(file)
    try:
        if isinstance(data, str):
            builder.parser = builder.new_parser("utf-8")
            data = data.encode("utf-8")
        builder.parser.Parse(data, True)
    except expat.ExpatError as error:
        what = expat.errors.messages.get(error.code, "not well-formed")
        message = f"this is not XML: {what}; every <element> needs its </element>, every attribute its quotes"
        raise ModelError([Problem(file, error.lineno, error.offset + 1, "", message)]) from None
    except (LookupError, ValueError) as error:  # encodings; characters that no text has
        raise ModelError([Problem(file, 1, 1, "", f"this is not XML: {error}; write the file in UTF-8")]) from None
    if builder.root is None:
        raise ModelError([Problem(file, 1, 1, "", "this is not XML: no element")])
    return builder.root


class _Builder:
    """Takes what expat finds."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.root: Element | None = None
        self.open: list[Element] = []
        self.count = 0
        self.parser = self.new_parser(None)

    def new_parser(self, encoding: str | None) -> Any:
        parser = expat.ParserCreate(encoding)
        parser.buffer_text = True
        parser.StartElementHandler = self.start
        parser.EndElementHandler = self.end
        parser.CharacterDataHandler = self.characters
        parser.EntityDeclHandler = self.refuse_entity
        parser.StartDoctypeDeclHandler = self.doctype
        return parser

    def stop(self, message: str) -> None:
        line, column = self.parser.CurrentLineNumber, self.parser.CurrentColumnNumber + 1
        raise ModelError([Problem(self.file, line, column, "", message)])

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        self.count += 1
        if self.count > MAX_ELEMENTS:
            self.stop(f"more than {MAX_ELEMENTS} elements; robots have far fewer")
        if len(self.open) >= MAX_DEPTH:
            self.stop(f"more than {MAX_DEPTH} levels of nesting; robots have far fewer")
        parser = self.parser
        element = Element(tag, attributes, parser.CurrentLineNumber, parser.CurrentColumnNumber + 1, self.file)
        if self.open:
            self.open[-1].children.append(element)
        else:
            self.root = element
        self.open.append(element)

    def end(self, tag: str) -> None:
        self.open.pop()

    def characters(self, text: str) -> None:
        if self.open:
            self.open[-1].text += text

    def refuse_entity(self, name: str, *rest: object) -> None:
        self.stop(f"declares the entity {name!r}; files with entities are not read: write out what it stands for")

    def doctype(self, name: str, system: str | None, public: str | None, has_internal: bool) -> None:
        if system or public:
            self.stop("refers to a document type in another file, which is not read; leave the DOCTYPE out")
