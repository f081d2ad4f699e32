"""YAML text as plain mappings, lists and strings, each with its place in the file.

The text is read event by event and not by `yaml.compose`. libyaml composes recursively in C, so a deeply nested file would end
the process, and the events take a third of the time. Scalars stay text, because the grammar of the model and not YAML's decides
what is a number (``1e-4`` is a string in YAML 1.1).
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final, TypeAlias

import yaml

from .errors import ModelError, Problem
from .file_bytes import read_bytes

MAX_BYTES: Final = 8 * 2**20
MAX_VALUES: Final = 1_000_000
"""Largest number of values in a file; this many are read within seconds."""
MAX_DEPTH: Final = 60
MAX_NOTES: Final = 200
ALIAS_ALLOWANCE: Final = 100_000
"""Number of values by which aliases may increase the number of values in the file."""

# a place is (line * _COLUMNS + column) * 4 + flags, to save memory
_COLUMNS: Final = 2**24
_ON_ONE_LINE: Final = 1
_QUOTED: Final = 2
_HALF: Final = 64
_WHOLE_HALF: Final = 2**_HALF - 1

Key = str | int
Path_ = tuple[Key, ...]

_TAGS = {"tag:yaml.org,2002:" + t for t in ("str", "int", "float", "map", "seq")}
_MERGE = "<<"

Digest: TypeAlias = "hashlib._Hash"


class Document:
    """Plain data with the place of every value.

    Parameters
    ----------
    file : str
        Name of the file in messages.
    root : Any
        Mappings, lists and scalars; scalars of a file are str, or None if nothing is written.

    Attributes
    ----------
    digest : hash object or None
        SHA-256 of the text.
    """

    def __init__(self, file: str, root: Any = None) -> None:
        self.file = file
        self.root = root
        self.problems: list[Problem] = []
        self.digest: Digest | None = None
        self._kept: list[Any] = []  # keeps ids valid
        # by id of a mapping: for each key the places of key and value in one number; by id of a list: the places of its values
        self._places: dict[int, dict[str, int] | list[int]] = {}

    def _place(self, start: Any, path: Path_, key: bool = False) -> int | None:
        """Place of the value (or key) at `path` from `start`, or of the last part of the path that exists."""
        found, container = None, start
        for part in path:
            places = self._places.get(id(container))
            if isinstance(places, dict) and isinstance(part, str) and part in places:
                found = places[part] >> _HALF if key else places[part] & _WHOLE_HALF
            elif isinstance(places, list) and isinstance(part, int) and part < len(places):
                found = places[part]
            else:
                continue  # a missing key, or pydantic's name of an alternative
            container = container[part]
        return found

    def place(
        self, start: Any, path: Path_, *, key: bool = False, inside: int | None = None
    ) -> tuple[int | None, int | None]:
        """Line and column of a value, counted from 1; None if there is no text.

        Parameters
        ----------
        start : dict or list
            Start of `path`.
        path : tuple
        key : bool
            Whether the place of the key is wanted.
        inside : int, optional
            Column within the scalar, counted from 1.
        """
        place = self._place(start, path, key)
        if place is None:
            begin = 1 if id(self.root) in self._places else None
            return begin, begin
        line, column = (place >> 2) // _COLUMNS + 1, (place >> 2) % _COLUMNS + 1
        if inside and place & _ON_ONE_LINE:
            column += inside - 1 + (1 if place & _QUOTED else 0)
        return line, column

    def merged(self, base: dict[str, Any], over: Mapping[str, Any], drop: tuple[str, ...] = ()) -> dict[str, Any]:
        """`base` without the keys `drop`, overlaid with `over`: mappings are merged, all other values are replaced."""
        result = {k: v for k, v in base.items() if k not in drop}
        places = {k: v for k, v in self.places_of(base).items() if k not in drop}
        over_places = self.places_of(over)
        for key, value in over.items():
            if key in over_places:
                places[key] = over_places[key]
            old = result.get(key)
            both = isinstance(old, dict) and isinstance(value, Mapping)
            result[key] = self.merged(old, value) if both and old is not None else value
        return self.made(result, places)

    def made(self, mapping: dict[str, Any], places: dict[str, int]) -> dict[str, Any]:
        """A mapping that is in no file, with the places of the data from which its keys were made."""
        self._places[id(mapping)] = places
        self._kept.append(mapping)
        return mapping

    def places_of(self, mapping: Mapping[str, Any]) -> dict[str, int]:
        places = self._places.get(id(mapping))
        return places if isinstance(places, dict) else {}


def show_path(path: Path_) -> str:
    """A path as text, such as ``bodies.crank.joint.at[0]``."""
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{_cut(part)}" if text else _cut(part)
    return text


def shortened(text: str) -> str:
    """A text of the file for messages: in quotes, and at most one line long."""
    return repr(_cut(text))


def _cut(text: str) -> str:
    text = text if text.isprintable() else repr(text)[1:-1]
    return text if len(text) <= 60 else text[:57] + "..."


def read_file(path: str | Path) -> str:
    """Read the text of a model file.

    Raises
    ------
    ModelError
        If the file cannot be read, is too large or is not text.
    """
    file = str(path)
    data = read_bytes(path, MAX_BYTES, "a readable model file is needed", "use repeat for repeated structure")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = data[: error.start].decode("utf-8", "replace")
        line, column = before.count("\n") + 1, len(before) - before.rfind("\n")
        message = f"byte 0x{data[error.start]:02x} is not valid in UTF-8; a model file is YAML in UTF-8"
        raise ModelError([Problem(file, line, column, "", message)]) from None


def digest_of_documents(documents: Iterable[Document]) -> str:
    """SHA-256 of a model's own text, followed by the SHA-256 of each of its other files; ``""`` for documents without a text."""
    first, *others = (document.digest for document in documents)
    if first is None:
        return ""
    whole = first.copy()
    for other in others:
        whole.update(b"" if other is None else other.digest())
    return whole.hexdigest()


def compose(text: str, file: str) -> Document:
    """Read a YAML text as a document.

    Raises
    ------
    ModelError
        If the text is not YAML, or its nesting or aliases exceed the limits.
    """
    document = Document(file)
    document.digest = hashlib.sha256(text.encode("utf-8", "surrogatepass"))
    try:
        document.root = _Composer(document).compose(_events(text))
    except yaml.MarkedYAMLError as error:
        found, what = _fault(error, text)
        line, column = (found.line + 1, found.column + 1) if found else (1, 1)
        raise ModelError([Problem(file, line, column, "", f"this is not YAML: {what}")]) from None
    except yaml.reader.ReaderError as error:
        line, column = _place_of_control(text)
        message = f"this is not YAML: {error.reason}; a model file is text"
        raise ModelError([Problem(file, line, column, "", message)]) from None
    except UnicodeError:
        raise ModelError([Problem(file, 1, 1, "", "contains characters outside Unicode; remove them")]) from None
    return document


_OPENED = (
    (
        "flow mapping",
        "the {{ of line {0} is not closed before this place, or a comma is missing; , or }} is needed here",
    ),
    (
        "flow sequence",
        "the [ of line {0} is not closed before this place, or a comma is missing; , or ] is needed here",
    ),
    (
        "block mapping",
        "a key with a colon is needed here, at the same indentation as the keys from line {0} on; "
        "check the indentation, and that the lines above are complete",
    ),
    (
        "block collection",
        "the list from line {0} on ends here; each of its entries begins with - at the same indentation",
    ),
)
"""What libyaml calls the part that it was reading, with a message that has the line where this part begins."""

_BEGUN = (
    ("escape", "an unknown escape after \\ in double quotes; write \\\\ for \\, or use single quotes"),
    ("quoted scalar", "the quote that begins here is not closed; close it where the text ends"),
    ("simple key", "this line has no colon; a key is written as key: value, with a space after the colon"),
    ("block scalar", "a text after | or > begins on the next line; a text that begins with | or > needs quotes"),
    ("anchor", "a name is needed after &; a text that begins with & needs quotes"),
    ("alias", "a name is needed after *; a text that begins with * needs quotes"),
    ("directive", "a line that begins with % is not allowed in a model file; remove it"),
    ("a tag", "a value that begins with ! is not allowed in a model file; a text needs quotes"),
)
"""Words in libyaml's error and a message; the message is about the beginning of the wrong part."""

_HERE = (
    (
        "mapping values",
        "a colon is not allowed here; a line above may lack the space after its colon, this line may be indented too far, "
        "or a text with a colon needs quotes",
    ),
    ("sequence entries", "a list does not begin on the line of its key; begin it on the next line, or write it in [ ]"),
    ("mapping keys", "? is not allowed here; a text that begins with ? needs quotes"),
    ("document start", "the document has ended above this line, at ...; a model file has only one document"),
    ("incompatible", "a line that begins with % is not allowed in a model file; remove it"),
)
"""Words in libyaml's error and a message; the message is about the place where libyaml stopped."""


def _fault(error: Any, text: str) -> tuple[Any, str]:
    """The place of an error of libyaml, and a message without libyaml's grammatical terms."""
    context, problem = error.context or "", error.problem or ""
    here, begun = error.problem_mark or error.context_mark, error.context_mark or error.problem_mark
    character = text[here.index : here.index + 1] if here else ""
    if "cannot start any token" in problem and character == "\t":
        return here, "a tab is not allowed here; indent with spaces"
    if "cannot start any token" in problem or "node content" in problem:
        begins = f"a value does not begin with {character!r}; a text that does needs quotes"
        return here, begins if character.strip() else "a value is needed here"
    if "block mapping" in context and character in ("}", "]"):
        return here, f"{character} closes nothing here; remove it, or add what it closes"
    for words, message in _OPENED:
        if words in context:
            return here, message.format(begun.line + 1)
    for words, message in _BEGUN:
        if words in f"{context} {problem}":
            return begun, message
    for words, message in _HERE:
        if words in problem:
            return here, message
    return here, f"{context} {problem}".strip()


def _events(text: str) -> Iterator[Any]:
    loader: Any = getattr(yaml, "CBaseLoader", yaml.BaseLoader)  # the fallback gives the same result, but is slower
    parser = loader(text)
    try:
        while (event := parser.get_event()) is not None:
            yield event
    finally:
        parser.dispose()


def _place_of_control(text: str) -> tuple[int, int]:
    match = re.search("[^\t\n\r\x20-\x7e\x85\xa0-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", text)
    start = match.start() if match else 0
    return text.count("\n", 0, start) + 1, start - text.rfind("\n", 0, start)


def _packed(event: Any) -> int:
    start, end = event.start_mark, event.end_mark
    place = (start.line * _COLUMNS + start.column) << 2
    if type(event) is yaml.ScalarEvent and end.line == start.line:
        place |= _ON_ONE_LINE | (_QUOTED if event.style in ("'", '"') else 0)
    return int(place)


class _Frame:
    """A mapping or list that is being read."""

    __slots__ = (
        "cut",
        "cut_at",
        "data",
        "event",
        "expects_key",
        "is_flow",
        "key",
        "key_event",
        "merges",
        "places",
        "size",
    )

    def __init__(self, data: Any, places: Any, event: Any) -> None:
        self.data = data
        self.places = places
        self.event = event
        self.expects_key = isinstance(data, dict)
        self.key: str | None = None
        self.key_event: Any = None
        self.merges: list[Any] = []
        self.size = 1
        self.is_flow = bool(getattr(event, "flow_style", False))
        self.cut = ""
        self.cut_at: Any = None

    @property
    def is_open(self) -> bool:
        """Whether the last value has an open parenthesis, so that the text after a comma belongs to it."""
        return self.cut.count("(") > self.cut.count(")")


class _Composer:
    def __init__(self, document: Document) -> None:
        self.document = document
        self.strings: dict[str, str] = {}
        self.anchors: dict[str, Any] = {}
        self.sizes: dict[int, int] = {}
        self.stack: list[_Frame] = []
        self.root: Any = None
        self.documents = 0
        self.written = 0

    def compose(self, events: Iterator[Any]) -> Any:
        for event in events:
            kind = type(event)
            if kind is yaml.ScalarEvent and self.stack and self.stack[-1].cut_at is not None and self.joined(event):
                continue
            if kind is yaml.ScalarEvent:
                # nothing is written, for instance after "forces:" with every line commented out
                value = None if event.style in (None, "") and event.value in ("", "~", "null") else event.value
                if value is not None and len(value) < 40:
                    value = self.strings.setdefault(value, value)  # equal texts are stored once
                self.tag(event)
                self.anchor(event, value)
                self.add(value, event, 1)
                self.may_be_cut(value, event)
            elif kind is yaml.MappingStartEvent or kind is yaml.SequenceStartEvent:
                self.open({} if kind is yaml.MappingStartEvent else [], event)
            elif kind is yaml.MappingEndEvent or kind is yaml.SequenceEndEvent:
                self.close()
            elif kind is yaml.AliasEvent:
                self.alias(event)
            elif kind is yaml.DocumentStartEvent:
                self.documents += 1
                if self.documents == 2:
                    self.note(event, "a second YAML document begins here; a model file has only one")
        return self.root

    def may_be_cut(self, value: Any, event: Any) -> None:
        """Note a value in braces or brackets that ends at a comma within its parentheses."""
        frame = self.stack[-1] if self.stack else None
        if frame is None or not frame.is_flow or value is None or event.style not in (None, ""):
            return
        if isinstance(frame.data, list) or (frame.expects_key and frame.key is not None):
            frame.cut = value
            frame.cut_at = event if frame.is_open else None

    def joined(self, event: Any) -> bool:
        """Whether a text belongs to the value before it, which YAML has cut at a comma; if so, it is appended there."""
        frame = self.stack[-1]
        if event.style not in (None, ""):
            frame.cut_at = None
            return False
        if not frame.is_open or (not event.value and isinstance(frame.data, dict)):
            if not frame.is_open:
                frame.cut_at = None
            return not event.value  # an empty value: YAML has taken the text before it as a key
        frame.cut += f", {event.value}"
        key: Any = len(frame.data) - 1 if isinstance(frame.data, list) else frame.key
        frame.data[key] = frame.cut
        if not frame.is_open:
            start = f"{key}: " if isinstance(key, str) else ""
            self.note(
                frame.cut_at,
                f'a comma in {{ }} or [ ] ends the value; put quotes around it: {start}"{_cut(frame.cut)}"',
            )
            if isinstance(frame.data, list):
                frame.cut_at = None
        return True

    def note(self, event: Any, message: str) -> None:
        mark: Any = event.start_mark
        path = show_path(tuple(f.key for f in self.stack if f.key is not None))
        self.document.problems.append(Problem(self.document.file, mark.line + 1, mark.column + 1, path, message))
        if len(self.document.problems) == MAX_NOTES:
            raise ModelError(self.document.problems)

    def stop(self, event: Any, message: str) -> None:
        self.note(event, message)
        raise ModelError(self.document.problems)

    def tag(self, event: Any) -> None:
        if event.tag is not None and event.tag not in _TAGS:
            self.note(event, f"tag {event.tag} is not allowed in a model file; remove it")

    def anchor(self, event: Any, value: Any) -> None:
        if event.anchor is not None:
            self.anchors[event.anchor] = value

    def open(self, data: Any, event: Any) -> None:
        if len(self.stack) >= MAX_DEPTH:
            self.stop(event, f"more than {MAX_DEPTH} levels of nesting; reduce them")
        self.tag(event)
        self.anchor(event, data)
        places: Any = {} if isinstance(data, dict) else []
        self.document._places[id(data)] = places
        self.document._kept.append(data)
        self.add(data, event, 0)
        self.stack.append(_Frame(data, places, event))

    def close(self) -> None:
        frame = self.stack.pop()
        for source in frame.merges:
            for one in source if isinstance(source, list) else [source]:
                if not isinstance(one, dict):
                    self.note(frame.event, "<< must be followed by a mapping or a list of mappings")
                    continue
                known = self.document.places_of(one)
                for key, value in one.items():
                    if key not in frame.data:
                        frame.data[key] = value
                        frame.places[key] = known[key]
        self.sizes[id(frame.data)] = frame.size
        self.grow(frame.size, frame.event)

    def grow(self, size: int, event: Any) -> None:
        if self.stack:
            self.stack[-1].size += size
            if self.stack[-1].size > self.written + ALIAS_ALLOWANCE:
                self.stop(
                    event, f"aliases repeat more than {ALIAS_ALLOWANCE} values here; use repeat for repeated structure"
                )

    def alias(self, event: Any) -> None:
        name = _cut(event.anchor)
        if event.anchor not in self.anchors:
            self.stop(event, f"alias *{name} has no anchor &{name} before it")
        value = self.anchors[event.anchor]
        if any(f.data is value for f in self.stack):
            self.stop(event, f"alias *{name} is inside the value that it repeats")
        self.add(value, event, self.sizes.get(id(value), 1))

    def add(self, value: Any, event: Any, size: int) -> None:
        """Add a value to the innermost mapping or list."""
        self.written += 1
        if self.written > MAX_VALUES:
            self.stop(event, f"more than {MAX_VALUES} keys and values; use repeat for repeated structure")
        if not self.stack:
            if self.documents == 1:
                self.root = value
            return
        frame = self.stack[-1]
        if size:
            self.grow(size, event)
        if isinstance(frame.data, list):
            frame.places.append(_packed(event))
            frame.data.append(value)
        elif frame.expects_key:
            frame.expects_key = False
            frame.key, frame.key_event = None, event
            if not isinstance(value, str):
                self.note(event, "this key is not a name; quote it, or put a name before the colon")
            elif value in frame.data:
                line = (frame.places[value] >> _HALF >> 2) // _COLUMNS + 1
                self.note(event, f"key {shortened(value)} is already used on line {line}; each key may be used once")
            else:
                frame.key = value
        else:
            frame.expects_key = True
            if frame.key == _MERGE and frame.key_event.style in (None, ""):
                frame.merges.append(value)
            elif frame.key is not None:
                frame.data[frame.key] = value
                frame.places[frame.key] = _packed(frame.key_event) << _HALF | _packed(event)
