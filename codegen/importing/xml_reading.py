"""XML parsed into elements with line numbers; only elements, attributes and text are read.

The parser is from defusedxml. It rejects document types, and thereby entities, default attributes and external files.
As in Pinocchio, MuJoCo and Drake, two things are tolerated: two dashes in a comment, and blanks before the declaration.
"""

from __future__ import annotations

import io
import os
import re
import stat
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final
from xml.sax import SAXException, SAXParseException
from xml.sax.handler import ContentHandler
from xml.sax.xmlreader import InputSource

from ..model import ModelError
from ..model.errors import Problem, within_a_line
from ..model.file_bytes import read_bytes

MAX_BYTES: Final = 64 * 2**20
MAX_ELEMENTS: Final = 1_000_000
MAX_DEPTH: Final = 100

_KINDS: Final = ((stat.S_ISSOCK, "a socket"), (stat.S_ISBLK, "a device"))
_ENDINGS: Final = {b"<!--": b"-->", b"<![CDATA[": b"]]>", b"<?": b"?>"}
_OPENINGS: Final = re.compile(rb"<!--|<!\[CDATA\[|<\?")
_NOT_A_LINE_END: Final = re.compile(rb"[^\r\n]+")
_LATE_DECLARATION: Final = re.compile(rb"(?:\xef\xbb\xbf)?((?:\s|<!--\s*-->)*)(<\?xml\s[^>]*\?>)")
_ENCODING: Final = re.compile(rb"""encoding\s*=\s*["']([A-Za-z0-9._-]+)["']""")
_NEEDED: Final = "a URDF, MJCF or SDF file is needed"


@dataclass(slots=True)
class Element:
    """An element of an XML file.

    Attributes
    ----------
    tag : str
    attributes : dict of str to str
    line, column : int
        Where the element begins, counted from 1.
    file : str
        The file's name in messages.
    children : list of Element
    text : str
        All text directly in the element.
    """

    tag: str
    attributes: dict[str, str]
    line: int
    column: int
    file: str
    children: list[Element] = field(default_factory=list)
    text: str = ""

    def all(self, *tags: str) -> Iterator[Element]:
        """The children with one of some tags."""
        return (c for c in self.children if c.tag in tags)

    def first(self, tag: str) -> Element | None:
        """The first child with a tag."""
        return next(self.all(tag), None)

    def problem(self, message: str, severity: str = "error") -> Problem:
        """An error or a warning at this element."""
        return Problem(self.file, self.line, self.column, "", within_a_line(message), severity)


def read_robot_file(path: str | Path) -> bytes:
    """Read the bytes of a robot's file.

    Raises
    ------
    ModelError
        If the file cannot be read to its end (a named pipe, for instance), is empty or too large.
    """
    message = no_regular_file(path)
    if message is not None:
        raise ModelError([Problem(str(path), 1, 1, "", f"cannot be read: {message}; {_NEEDED}")])
    data = read_bytes(path, MAX_BYTES, _NEEDED, "robots have far less")
    if not data.strip():
        raise ModelError([Problem(str(path), 1, 1, "", f"the file is empty; {_NEEDED}")])
    return data


def no_regular_file(path: str | os.PathLike[str]) -> str | None:
    """Reason why a path, such as a named pipe, cannot be read to an end; pipes of this process, such as /dev/stdin, are
    allowed."""
    try:
        mode = os.stat(path).st_mode
        resolved = os.path.realpath(path)
    except (OSError, ValueError):
        return None
    if stat.S_ISFIFO(mode) and not resolved.startswith(("/proc/", "/dev/fd/")):
        return "it is a named pipe"
    return next((f"it is {kind}" for is_kind, kind in _KINDS if is_kind(mode)), None)


def parse_xml(data: bytes | str, file: str) -> Element:
    """Parse an XML text; returns its root element.

    Raises
    ------
    ModelError
        If the text is not XML, has a document type, or exceeds the limits.
    """
    from defusedxml import DefusedXmlException
    from defusedxml.expatreader import create_parser

    encoding: str | None = None
    if isinstance(data, str):
        data, encoding = data.encode("utf-8", "surrogatepass"), "utf-8"
    text, declared = _tolerated(data)
    encoding = encoding or declared
    handler = _Handler(file)
    parser: Any = create_parser(forbid_dtd=True)
    parser.setContentHandler(handler)
    source = InputSource(file)
    source.setByteStream(io.BytesIO(text))
    if encoding is not None:
        source.setEncoding(encoding)
    try:
        parser.parse(source)
    except DefusedXmlException:
        message = "a document type (DOCTYPE) is not read, since it can bring entities and default attributes; remove it"
        raise ModelError([handler.problem(message)]) from None
    except SAXParseException as error:
        advice = "every <element> needs an </element>, every attribute needs quotes"
        if file.endswith((".yaml", ".yml")):
            advice = f"a model file needs no import: ordernm generate {file}"
        message = f"this is not XML: {error.getMessage()}; {advice}"
        line, column = error.getLineNumber() or 1, (error.getColumnNumber() or 0) + 1
        raise ModelError([Problem(file, line, column, "", message)]) from None
    except (SAXException, LookupError, ValueError) as error:  # unknown encodings, and invalid characters
        raise ModelError([Problem(file, 1, 1, "", f"this is not XML: {error}; write the file in UTF-8")]) from None
    if handler.root is None:
        raise ModelError([Problem(file, 1, 1, "", "this is not XML: no element")])
    return handler.root


def _tolerated(data: bytes) -> tuple[bytes, str | None]:
    """The text without the two faults that are tolerated, and the encoding of a declaration that was removed.

    Comments, and a declaration that is not at the beginning, are replaced by blanks: all other bytes keep their places.
    """
    if b"\0" in data[:4] or data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return data, None  # encodings with two or four bytes per character
    found, place = [], 0
    while (opening := _OPENINGS.search(data, place)) is not None:
        ending = _ENDINGS[opening[0]]
        end = data.find(ending, opening.end())
        if end < 0:
            break
        if opening[0] == b"<!--":
            found += [data[place : opening.end()], _NOT_A_LINE_END.sub(_blanks, data[opening.end() : end]), ending]
        else:
            found.append(data[place : end + len(ending)])
        place = end + len(ending)
    text = b"".join([*found, data[place:]])
    late = _LATE_DECLARATION.match(text)
    if late is None or not late[1]:
        return text, None
    encoding = _ENCODING.search(late[2])
    name = None if encoding is None else encoding[1].decode("ascii", "replace")
    start, end = late.span(2)
    return text[:start] + _NOT_A_LINE_END.sub(_blanks, late[2]) + text[end:], name


def _blanks(match: re.Match[bytes]) -> bytes:
    return b" " * len(match[0])


class _Handler(ContentHandler):
    """Builds elements from the events of the parser."""

    def __init__(self, file: str) -> None:
        super().__init__()
        self.file = file
        self.root: Element | None = None
        self.open: list[tuple[Element, list[str]]] = []
        self.count = 0
        self.locator: Any = None

    def setDocumentLocator(self, locator: Any) -> None:
        self.locator = locator

    def place(self) -> tuple[int, int]:
        return self.locator.getLineNumber() or 1, (self.locator.getColumnNumber() or 0) + 1

    def problem(self, message: str) -> Problem:
        return Problem(self.file, *self.place(), "", message)

    def startElement(self, name: str, attrs: Any) -> None:
        self.count += 1
        if self.count > MAX_ELEMENTS:
            raise ModelError([self.problem(f"more than {MAX_ELEMENTS} elements; simplify the file")])
        if len(self.open) >= MAX_DEPTH:
            raise ModelError([self.problem(f"more than {MAX_DEPTH} levels of nesting; simplify the file")])
        element = Element(name, dict(attrs.items()), *self.place(), self.file)
        if self.open:
            self.open[-1][0].children.append(element)
        else:
            self.root = element
        self.open.append((element, []))

    def endElement(self, name: str) -> None:
        element, texts = self.open.pop()
        element.text = "".join(texts)

    def characters(self, content: str) -> None:
        if self.open:
            self.open[-1][1].append(content)
