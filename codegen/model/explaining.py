"""Reads entries of a model file with Pydantic, and expresses its errors in the terms of the format."""

from __future__ import annotations

from typing import Any, Final, get_args

from pydantic import TypeAdapter, ValidationError

from ..wording import DECIMAL_POINT
from .entries import Entry, FaceEntry, PlacedEntry, PointEntry, shown
from .errors import nearest
from .forces import OTHER_WORDS
from .joints import JOINTS
from .positions import Path_
from .schema import JointEntry, LoopJointEntry, ShapeEntry
from .visuals import VisualEntry


def validate(cls: Any, value: Any) -> Any:
    """An entry of a class, or of one of the classes of a union."""
    adapter = _adapters.get(id(cls))
    if adapter is None:
        adapter = _adapters[id(cls)] = TypeAdapter(cls)
    return adapter.validate_python(value)


_adapters: Final[dict[int, TypeAdapter[Any]]] = {}


def repaired(cls: Any, value: Any, error: ValidationError) -> Any:
    """An entry of `cls` in which wrong parts are left out or replaced, so that the other parts can be checked; None if
    that is impossible."""
    if not isinstance(value, dict):
        return None
    choices = _models(cls)
    chosen = next((c for c in choices if len(choices) == 1 or _tag(c) == value.get("type")), None)
    if chosen is None:
        return None
    placeholders = chosen.placeholders
    result = _copied(value)
    for item in error.errors(include_url=False):
        path = _without_alternatives(cls, tuple(item["loc"]))
        if not path:
            result.pop("shape", None)
        elif path[0] in placeholders:
            result[path[0]] = placeholders[str(path[0])]
        elif item["type"] == "extra_forbidden" and _at(result, path[:-1]) is not None:
            _at(result, path[:-1]).pop(path[-1], None)
        elif item["type"] == "model" and _at(result, path[:-1]) is not None:
            _at(result, path[:-1])[path[-1]] = "1"
        else:
            result.pop(path[0], None)
    try:
        return validate(cls, result)
    except ValidationError:
        return None


def _copied(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _copied(v) for k, v in value.items()}
    return [_copied(v) for v in value] if isinstance(value, (list, tuple)) else value


def _at(value: Any, path: Path_) -> Any:
    """The mapping or list at a path; None if there is none."""
    for part in path:
        if not isinstance(value, (dict, list)):
            return None
        try:
            value = value[part]  # type: ignore[index]
        except (KeyError, IndexError, TypeError):
            return None
    return value if isinstance(value, (dict, list)) else None


# --- pydantic's errors in the terms of the format ----------------------------------------------------------------


def explain(cls: Any, error: ValidationError) -> list[tuple[Path_, str, bool, int]]:
    """Pydantic's errors in the terms of the format.

    Parameters
    ----------
    cls : type or union
        The class given to `validate`.
    error : ValidationError

    Returns
    -------
    list of (path, message, at_key, column)
        `path` is relative to the entry. `at_key` means that the key is wrong, not its value. `column` is a place in a text, or 0.
    """
    result: list[tuple[Path_, str, bool, int]] = []
    reported: set[tuple[Path_, str]] = set()
    items = error.errors(include_url=False)
    unknown = [(tuple(i["loc"][:-1]), str(i["loc"][-1])) for i in items if i["type"] == "extra_forbidden"]
    misspelt = {(loc, _unknown_key(key, _entry_at(cls, loc)).rpartition("; ")[2]) for loc, key in unknown}
    for item in items:
        loc: Path_ = tuple(item["loc"])
        kind, value, context = item["type"], item["input"], item.get("ctx", {})
        here = _entry_at(cls, loc[:-1] if kind in ("missing", "extra_forbidden") else loc)
        shown_path = _without_alternatives(cls, loc)
        at_key, column = False, 0
        if kind == "model":
            message, column = str(context["message"]), int(context["column"])
        elif kind == "missing" and isinstance(loc[-1], int):
            loc, shown_path = loc[:-1], shown_path[:-1]
            message = f"too few numbers; {_wanted(loc)}"
        elif kind in ("too_long", "too_short", "tuple_type", "list_type"):
            message = f"{shown(value)}; {_wanted(loc)}"
        elif kind == "missing":
            if (loc[:-1], f"did you mean {loc[-1]!r}?") in misspelt:
                continue  # already reported as a misspelt key
            message = f"key {loc[-1]!r} is missing; keys here: {_keys(here)}"
            shown_path = shown_path[:-1]
        elif kind == "extra_forbidden":
            message = _unknown_key(str(loc[-1]), here)
            at_key = True
        elif kind == "union_tag_not_found":
            message = f"key 'type' is missing; one of {_tags(_alternatives(cls, loc))} is needed"
        elif kind == "union_tag_invalid":
            message = _unknown_type(value, _alternatives(cls, loc))
            shown_path = (*shown_path, "type")
        elif kind in ("model_type", "model_attributes_type", "dict_type"):
            choices = _alternatives(cls, loc)
            keys = f"the keys {_keys(here)}" if len(choices) < 2 else f"a type: one of {_tags(choices)}"
            named = "the name of a point or " if loc and here in (PointEntry, FaceEntry) else ""
            message = f"{shown(value)}; {named}a mapping is needed with {keys}"
        elif kind == "string_type":
            message = f"{shown(value)}; a text is needed"
        else:
            message = f"{shown(value)}: {item['msg']}"
        if (shown_path, message) not in reported:
            reported.add((shown_path, message))
            result.append((shown_path, message, at_key, column))
    return result


def _wanted(loc: Path_) -> str:
    last = loc[-1] if loc else ""
    if last == "axes":
        return "two axes are needed: [y, x]"
    if last == "rotate":
        return "a list of rotations is needed: [{axis: z, angle: 0.5}]"
    if last in ("axis", "normal") or isinstance(last, int):
        return "x, y, z, -x, -y, -z or a vector [x, y, z] is allowed"
    if last == "rpy":
        return "three angles are needed: [roll, pitch, yaw]"
    return "three numbers are needed: [x, y, z]"


def _fields(cls: type[Entry]) -> dict[str, Any]:
    """Fields of an entry class by the keys of the file."""
    return {f.alias or name: f for name, f in cls.model_fields.items()}


def _keys(cls: type[Entry]) -> str:
    return ", ".join(_fields(cls))


def _unknown_key(key: str, here: type[Entry]) -> str:
    if key in ("first", "last"):
        return f"{key!r} is only allowed directly inside an entry of a repeat block"
    if issubclass(here, LoopJointEntry) and key in PlacedEntry.model_fields:
        return f"{key!r} is not a key of a loop's joint; write it in from or to: from: {{body: arm, {key}: ...}}"
    correct = here.misspelt.get(key)
    hint = f"; did you mean {correct!r}?" if correct else nearest(key, _fields(here))
    if key[:1].isdigit():
        hint = DECIMAL_POINT  # YAML ends the value 0,6 at its comma
    return f"unknown key {key!r}; keys here: {_keys(here)}{hint}"


def _tag(cls: type[Entry]) -> str:
    return str(get_args(cls.model_fields["type"].annotation)[0])


def _tags(classes: list[type[Entry]]) -> str:
    return ", ".join(_tag(c) for c in classes)


_KINDS: Final[dict[str, type[Entry]]] = {
    "joint": JointEntry, "loop joint": LoopJointEntry, "shape": ShapeEntry, "visual": VisualEntry,
}  # fmt: skip


def _unknown_type(value: Any, classes: list[type[Entry]]) -> str:
    name = value.get("type") if isinstance(value, dict) else value
    kind = next((k for k, base in _KINDS.items() if issubclass(classes[0], base)), "force")
    if kind == "loop joint" and isinstance(name, str) and name in JOINTS and not JOINTS[name].closure:
        return f"a {name} joint {JOINTS[name].closes_none}; one of {_tags(classes)} is allowed"
    hint = nearest(name, [_tag(c) for c in classes]) if isinstance(name, str) else ""
    correct = OTHER_WORDS.get(name) if kind == "force" and isinstance(name, str) else None
    if correct in [_tag(c) for c in classes]:
        hint = f"; did you mean {correct!r}?"
    return f"unknown {kind} type {shown(name)}; one of {_tags(classes)} is allowed{hint}"


def _models(annotation: Any) -> list[type[Entry]]:
    if isinstance(annotation, type) and issubclass(annotation, Entry):
        return [annotation]
    return list(dict.fromkeys(m for a in get_args(annotation) for m in _models(a)))


def _steps(cls: Any, loc: Path_) -> list[tuple[Any, list[type[Entry]], bool]]:
    """For every part of a location: the part, the possible entry classes of its value, and whether the part names a
    type."""
    steps: list[tuple[Any, list[type[Entry]], bool]] = []
    classes = _models(cls)
    for part in loc:
        tagged = [c for c in classes if len(classes) > 1 and "type" in c.model_fields and _tag(c) == part]
        if tagged:
            classes = tagged
            steps.append((part, classes, True))
            continue
        if isinstance(part, str):
            found = [_fields(c)[part].annotation for c in classes if part in _fields(c)]
            if found or len(classes) != 1:
                classes = [m for a in found[:1] for m in _models(a)]
            elif part.startswith("function-") or "[" in part:
                steps.append((part, classes, True))
                continue
        steps.append((part, classes, False))
    return steps


def _alternatives(cls: Any, loc: Path_) -> list[type[Entry]]:
    return _steps(cls, loc)[-1][1] if loc else _models(cls)


def _entry_at(cls: Any, loc: Path_) -> type[Entry]:
    """The class of the mapping that contains (or is) the value at `loc`."""
    entry = _models(cls)[0]
    for _, classes, _alternative in _steps(cls, loc):
        if len(classes) == 1:
            entry = classes[0]
    return entry


def _without_alternatives(cls: Any, loc: Path_) -> Path_:
    return tuple(part for part, _, alternative in _steps(cls, loc) if not alternative)
