"""Included files of a model, and submodels: files whose names get a prefix, so that a model can use one file several times."""

from __future__ import annotations

from functools import partial

from ..entries import shown
from ..errors import nearest
from ..parts import MAX_PARTS, Given, Instance, Part
from ..positions import Document
from ..reading import Reader
from ..repetition import CannotGoOn
from ..schema import SECTIONS, SubmodelEntry
from ..unknown_names import some
from .quantities import read_constants


def read_files(reader: Reader) -> None:
    """Open all files, and read their constants, on which the number of submodels may depend."""
    waiting = [reader.own]
    before = reader.errors
    while waiting:
        part = waiting.pop(0)
        reader.parts.remove(part)
        parts = _with_included(reader, part)
        for one in parts:
            _check_keys(reader, one)
        read_constants(reader, parts)
        for at in reader.section("submodels", parts):
            submodel = _submodel(reader, at)
            if submodel is not None:
                waiting.append(reader.added(submodel))
                if len(reader.parts) > MAX_PARTS:
                    message = f"more than {MAX_PARTS} uses of files; reading them would take too long: use fewer"
                    reader.report(at, (), message, key=True)
                    raise CannotGoOn
    if reader.errors > before and reader.files.is_wanting:
        raise CannotGoOn  # contents of a missing file would be reported as unknown elsewhere


def check_given(reader: Reader) -> None:
    """Report numbers that are given to submodels under names which the submodels do not have."""
    for part in reader.parts:
        if part.frame is None:
            continue
        for name, given in part.given.items():
            if not given.used:
                reader.report(given.at, ("with", given.key), partial(_not_there, reader, part, name), key=True)


def _not_there(reader: Reader, part: Part, name: str) -> str:
    names = [n for n in part.constants if n[0] != "'" and "." not in n] + part.own([*reader.defaults, *reader.inputs])
    known = list(dict.fromkeys(names))
    return (
        f"{part.document.file} has no constant, parameter or input {name!r}; it has {some(known)}{nearest(name, known)}"
    )


def _check_keys(reader: Reader, part: Part) -> None:
    for key in part.document.root:
        if key not in SECTIONS:
            hint = nearest(key, SECTIONS)
            reader.report(part.entry(key), (), f"unknown key {key!r}; keys here: {some(SECTIONS)}{hint}", key=True)


def _with_included(reader: Reader, part: Part) -> list[Part]:
    """The files that a file includes, each after its own included files, then the file itself; all are added to the
    reader."""
    found: list[Part] = []
    at = part.entry("include")
    if at.value is not None and not isinstance(at.value, (list, tuple)):
        reader.report(at, (), f"{shown(at.value)}; a list of files is needed: [materials.yaml]")
    elif at.value is not None:
        for i, item in enumerate(at.value):
            document = _opened(reader, at, (i,), item)
            if document is not None:
                found += _with_included(reader, part.including(document))
    return [*found, reader.added(part)]


def _opened(reader: Reader, at: Instance, path: tuple[str | int, ...], text: object) -> Document | None:
    """The file at a path; None after an error."""
    wanting, reader.files.is_wanting = reader.files.is_wanting, True
    if not isinstance(text, str):
        reader.report(at, path, f"{shown(text)}; give a file by its path from this one: parts/leg.yaml")
        return None
    found = reader.files.open(text, at.part.document, reader.add)
    if isinstance(found, str):
        reader.report(at, path, found)
        return None
    chain = at.part.chain()
    if found in chain:
        circle = [d.file for d in reversed(chain[: chain.index(found) + 1])]
        reader.report(
            at,
            path,
            f"files read each other in a circle, {' -> '.join([*circle, found.file])}; remove one of these uses",
        )
        return None
    reader.files.is_wanting = wanting
    return found


def _submodel(reader: Reader, at: Instance) -> Part | None:
    """The use of a file by an entry of ``submodels``; None after an error."""
    spec = reader.spec(SubmodelEntry, at)
    if not reader.is_whole(spec):
        reader.files.is_wanting = True
        return None
    document = _opened(reader, at, ("use",), spec.use)
    if document is None:
        return None
    local = reader.name_at(at, (), at.key, key=True)
    if local is None:
        return None
    name = at.part.name(local)
    given = {}
    for key, value in spec.given.items():
        its_name = reader.name_at(at, ("with", key), key, key=True)
        if its_name is not None:
            given[its_name] = Given(value, at, key)
    return Part(document, at.part, f"{name}_", _frame(at), name, given=given)


def _frame(at: Instance) -> Instance:
    """The massless body that replaces a submodel's ground, fixed where the entry says."""
    document = at.part.document
    places = document.places_of(at.value)
    joint = document.merged(at.value, {}, drop=("use", "on", "with"))
    joint["type"] = "fixed"
    value = {"parent": at.value.get("on", "ground"), "joint": joint}
    document.made(value, {"parent": places["on"]} if "on" in places else {})
    container = document.made(
        {at.key: value}, {k: v for k, v in document.places_of(at.container).items() if k == at.key}
    )
    return Instance(at.key, value, container, at.section, at.indices, at.part)
