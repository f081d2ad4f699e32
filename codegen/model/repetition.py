"""``repeat INDEX in RANGE:`` blocks: entries of a section that are written once and repeated.

The entries inside a block are templates, which are parsed once. A repetition is the template together with the values of its
indices; everything that does not use an index is shared by all repetitions.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from .binding import Numbers, Scope, bind, index_text, label_key
from .entries import RESERVED
from .errors import Problem
from .grammar import ExpressionError, Number
from .parsing import parse
from .parts import Instance, Part
from .positions import Path_, shortened, show_path

MAX_REPETITIONS: Final = 400_000
"""Largest number of repeated entries of a model; this many are read within seconds."""

_HEADER = re.compile(r"repeat\s+([A-Za-z_][A-Za-z0-9_]*)\s+in\s+(.*\S)\s*", re.DOTALL)
_LABEL = re.compile(r"[A-Za-z0-9_]+")
_FORM = "write 'repeat k in 1..n:', 'repeat k in 1..n step 2:' or 'repeat leg in left, right:'"


class CannotGoOn(Exception):
    """Raised if continuing would cause false error messages, or take too long."""


@dataclass(slots=True)
class Counter:
    """Counts the repeated entries of a model."""

    repeated: int = 0


class Repetition:
    """Expands the repeat blocks of one file.

    Parameters
    ----------
    part : Part
        The file. Its constants are read when a range is, so constants may still be added.
    report : callable
        Receives a `Problem`.
    counter : Counter
        Counter of the whole model.
    """

    def __init__(self, part: Part, report: Callable[[Problem], None], counter: Counter) -> None:
        self.part = part
        self.document = part.document
        self.report = report
        self.constants: Mapping[str, Number | str] = part.constants
        self.counter = counter
        self._variants: dict[tuple[int, bool, bool], tuple[Any, dict[str, Any]]] = {}

    def expand(self, section: dict[str, Any], path: Path_) -> Iterator[Instance]:
        """Entries of a section in order; the entries of a repeat block come one repetition after the other."""
        return self._expand(section, path, {}, False, False)

    def _expand(
        self, container: dict[str, Any], path: Path_, indices: dict[str, int | str], first: bool, last: bool
    ) -> Iterator[Instance]:
        for key, value in container.items():
            if key != "repeat" and not key.startswith("repeat "):
                if indices and isinstance(value, dict) and ("first" in value or "last" in value):
                    value, holder = self._variant(container, key, first, last, path)
                    yield Instance(key, value, holder, path, indices, self.part)
                else:
                    yield Instance(key, value, container, path, indices, self.part)
                continue
            header = self._header(container, key, path, indices)
            if header is None:
                continue
            index, values = header
            self.counter.repeated += _length(values) * max(1, sum(not k.startswith("repeat") for k in value))
            if self.counter.repeated > MAX_REPETITIONS:
                message = (
                    f"with this block the model has {self.counter.repeated} repeated entries; "
                    f"up to {MAX_REPETITIONS} are allowed, since reading more would take too long"
                )
                self._problem(container, (key,), path, message)
                raise CannotGoOn
            for number, chosen in enumerate(values):
                inner = {**indices, index: chosen}
                yield from self._expand(value, path, inner, number == 0, number == len(values) - 1)

    def _variant(
        self, container: dict[str, Any], key: str, first: bool, last: bool, path: Path_
    ) -> tuple[Any, dict[str, Any]]:
        """An entry with its ``first`` and ``last`` keys applied, and a copy of its container with this entry."""
        value = container[key]
        first, last = first and "first" in value, last and "last" in value
        known = self._variants.get((id(value), first, last))
        if known is None:
            merged = value
            for part, applies in (("first", first), ("last", last)):
                over = value.get(part)
                if part in value and not isinstance(over, dict):
                    message = "a mapping is needed: the keys that differ in this repetition"
                    self._problem(container, (key, part), path, message, at_key=False)
                    over = {}
                merged = self.document.merged(merged, over if applies and over else {}, drop=("first", "last"))
            known = self._variants[id(value), first, last] = merged, self.document.merged(container, {key: merged})
        return known

    def _problem(
        self, container: dict[str, Any], keys: tuple[str, ...], path: Path_, message: str, at_key: bool = True
    ) -> None:
        line, column = self.document.place(container, keys, key=at_key)
        self.report(Problem(self.document.file, line, column, show_path((*path, *keys)), message))

    def _header(
        self, container: dict[str, Any], key: str, path: Path_, indices: dict[str, int | str]
    ) -> tuple[str, range | list[int | str]] | None:
        """Index and values of a repeat block; None after an error."""
        match = _HEADER.fullmatch(key)
        if match is None:
            self._problem(container, (key,), path, f"{shortened(key)} is not a repetition; {_FORM}")
            return None
        index, text = match.groups()
        if index in RESERVED or index in indices or index in self.constants:
            taken = "reserved" if index in RESERVED else "already the name of an index or a constant"
            self._problem(container, (key,), path, f"index {index!r} is {taken}; choose another name")
            return None
        if container[key] is None and self._is_cut(container, key, text):
            message = (
                f"YAML ends this key at its comma, because it is inside {{ }}; quote the key: {{'repeat {index} in {text}, ...': "
                f"{{...}}}}, or write the block without {{ }}"
            )
            self._problem(container, (key,), path, message)
            raise CannotGoOn
        if not isinstance(container[key], dict):
            message = "a repeat block is empty; put the entries to repeat under it"
            self._problem(container, (key,), path, message)
            return None
        try:
            return index, self._values(text, Scope(indices, self.constants))
        except ExpressionError as error:
            self._problem(container, (key,), path, f"{shortened(text)}: {error.message}; {_FORM}")
            return None

    @staticmethod
    def _is_cut(container: dict[str, Any], key: str, text: str) -> bool:
        """Whether YAML has cut the labels of a repeat block into the next key, as in ``{repeat s in left, right: {...}}``."""
        following = list(container)[list(container).index(key) + 1 :]
        return ".." not in text and bool(following) and _LABEL.fullmatch(following[0]) is not None

    def _values(self, text: str, numbers: Numbers) -> range | list[int | str]:
        if ".." in text:
            begin, _, rest = text.partition("..")
            end, *more = re.split(r"\bstep\b", rest)
            ends = [self._whole(t, numbers) for t in (begin, end, *more)]
            if len(ends) > 3:
                raise ExpressionError("step may be given only once")
            step = ends[2] if len(ends) == 3 else 1
            if step < 1:
                raise ExpressionError(f"step is {step}; it must be at least 1")
            return range(ends[0], ends[1] + 1, step)
        labels = [t.strip() for t in text.split(",")]
        for label in labels:
            if not _LABEL.fullmatch(label):
                raise ExpressionError(f"{label!r} is not a label; a label has letters, digits and _")
        if len(labels) == 1 and not labels[0].isdigit():
            raise ExpressionError("this is neither a range nor a list of labels")
        if len(set(labels)) < len(labels):
            raise ExpressionError("a label is given twice")
        return [int(t) if t.isdigit() and len(t) < 16 else t for t in labels]

    @staticmethod
    def _whole(text: str, numbers: Numbers) -> int:
        value = bind(parse(text.strip()), numbers)
        if not value.is_number:
            raise ExpressionError(
                f"{text.strip()} is unknown; a range may have numbers, constants and indices of outer blocks"
            )
        if not isinstance(value.value, int):
            raise ExpressionError(f"{text.strip()} is {value.value}; an integer is needed")
        return value.value


def _length(values: range | list[int | str]) -> int:
    """The number of values, also for ranges beyond the machine's integers."""
    if isinstance(values, list):
        return len(values)
    return max(0, (values.stop - values.start + values.step - 1) // values.step)


def labels(root: Any) -> dict[str, str]:
    """The labels of all repeat blocks of a document, by their `label_key`."""
    found: dict[str, str] = {}
    waiting = list(root.values()) if isinstance(root, dict) else []
    while waiting:
        value = waiting.pop()
        if isinstance(value, list):
            waiting.extend(v for v in value if isinstance(v, dict))
        elif isinstance(value, dict):
            for key, inner in value.items():
                match = _HEADER.fullmatch(key) if isinstance(key, str) and key.startswith("repeat ") else None
                if match and ".." not in match.group(2):
                    found.update((label_key(t.strip()), t.strip()) for t in match.group(2).split(","))
                if match or key in ("q", "u"):
                    waiting.append(inner)
    return found


def name_of(tree: Any, numbers: Numbers) -> str:
    """The name that a tree denotes, with its indices replaced: ``link(k-1)`` is ``link_2`` at k = 3.

    Raises
    ------
    ExpressionError
        If an index has no value.
    """
    if tree[0] == "name":
        return str(tree[1])
    if len(tree[2]) == 1:
        return f"{tree[1]}_{index_text(tree[2][0], numbers)}{tree[3]}"
    return "_".join([tree[1], *[index_text(i, numbers) for i in tree[2]]]) + str(tree[3])
