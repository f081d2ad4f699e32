"""Compact form of long lists of names and numbers: repetitions that come from ``repeat`` in a model file are written once.

If a pattern of items repeats within a list and its integers grow in equal steps, the repetitions become one `Repeated`. The run
time (`codegen.runtime.standalone.files.manifest.unrolled`) restores the list.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence

from ..records import dataclass

SHORT = 24
"""Lists up to this length are written in full, so that people can read them."""

LONGEST = 16
"""Largest number of items in a repeated pattern."""

Item = str | int | float

Form = str | type[int] | tuple[str, str]
"""An item with placeholders in place of its integers: a name with ``{}``, an integer, or another number."""

_INTEGER = re.compile(r"(?<!\d)(?:0|[1-9]\d*)(?!\d)")


@dataclass(frozen=True, slots=True)
class Repeated:
    """A repeated pattern of a list.

    Attributes
    ----------
    count : int
        Number of repetitions.
    items : tuple
        The pattern. In names, integers that grow are written ``{0}``, ``{1}``, ...; an item that is itself such an integer is
        written as ``(0,)``, ``(1,)``, ...
    start, step : tuple of int
        First value and step of each of these integers.
    """

    count: int
    items: tuple[Item | tuple[int], ...]
    start: tuple[int, ...]
    step: tuple[int, ...]

    def as_json(self) -> dict[str, object]:
        items = [list(i) if isinstance(i, tuple) else i for i in self.items]
        found: dict[str, object] = {"repeat": self.count, "of": items}
        return found | ({"from": list(self.start), "step": list(self.step)} if self.start else {})


def repeated(values: Sequence[Item]) -> list[Item | Repeated]:
    """The list with repetitions replaced by `Repeated`. The search is greedy and takes time linear in the length."""
    if len(values) <= SHORT or any(isinstance(v, str) and ("{" in v or "}" in v) for v in values):
        return list(values)
    forms = [_form(v) for v in values]
    result: list[Item | Repeated] = []
    i = 0
    while i < len(values):
        best: tuple[int, int] = (1, 1)
        form = forms[i][0]
        for period in range(1, min(LONGEST, (len(values) - i) // 3) + 1):
            if forms[i + period][0] != form:
                continue
            count = _count(forms, i, period)
            if count > 2 and count * period > best[0] * best[1]:
                best = count, period
            if i + (count + 1) * period > len(values):
                break  # this pattern repeats up to the end of the list
        count, period = best
        if count * period <= SHORT:
            result.append(values[i])
            i += 1
            continue
        result.append(_repeated(forms, i, period, count))
        i += count * period
    return result


def _form(value: Item) -> tuple[Form, tuple[int, ...]]:
    """The form of an item, and the integers that the form has placeholders for."""
    if isinstance(value, str):
        return "{}".join(_INTEGER.split(value)), tuple(map(int, _INTEGER.findall(value)))
    if isinstance(value, int):
        return int, (value,)
    return ("number", repr(value)), ()


def _count(forms: Sequence[tuple[Form, tuple[int, ...]]], start: int, period: int) -> int:
    """The number of times that a list repeats its first items from a given position on."""
    steps = []
    for k in range(start, start + period):
        (form, integers), (next_form, next_integers) = forms[k], forms[k + period]
        if form != next_form or len(integers) != len(next_integers):
            return 1
        steps.append(tuple(b - a for a, b in zip(integers, next_integers, strict=True)))
    j = start + period
    while j + period < len(forms):
        (form, integers), (next_form, next_integers) = forms[j], forms[j + period]
        step = steps[(j - start) % period]
        if form != next_form or tuple(a + s for a, s in zip(integers, step, strict=True)) != next_integers:
            break
        j += 1
    return (j + period - start) // period


def _repeated(forms: Sequence[tuple[Form, tuple[int, ...]]], i: int, period: int, count: int) -> Repeated:
    items: list[Item | tuple[int]] = []
    start: list[int] = []
    step: list[int] = []
    for k in range(i, i + period):
        form, integers = forms[k]
        steps = [b - a for a, b in zip(integers, forms[k + period][1], strict=True)]
        if isinstance(form, tuple):
            items.append(float(form[1]))
        elif isinstance(form, str):
            places = []
            for value, change in zip(integers, steps, strict=True):
                places.append(f"{{{len(start)}}}" if change else str(value))
                if change:
                    start.append(value)
                    step.append(change)
            items.append(form.format(*places))
        else:
            items.append((len(start),))
            start.append(integers[0])
            step.append(steps[0])
    return Repeated(count, tuple(items), tuple(start), tuple(step))


def condensed(value: object) -> object:
    """JSON data with long lists in compact form."""
    if isinstance(value, dict):
        return {key: condensed(v) for key, v in value.items()}
    if isinstance(value, (list, tuple)):
        if all(isinstance(v, (str, int, float)) and not isinstance(v, bool) for v in value):
            return [v.as_json() if isinstance(v, Repeated) else v for v in repeated(value)]
        return [condensed(v) for v in value]
    return value


def json_text(data: object) -> str:
    """JSON of compact data, with a line for each entry of nested dictionaries, and each list in one line."""
    return _json(condensed(data), 0) + "\n"


def _json(value: object, depth: int) -> str:
    if depth > 2 or not isinstance(value, dict) or not value:
        return json.dumps(value)
    lines = (f"{' ' * (depth + 1)}{json.dumps(key)}: {_json(entry, depth + 1)}" for key, entry in value.items())
    return "{\n" + ",\n".join(lines) + f"\n{' ' * depth}}}"


__all__ = ["Repeated", "condensed", "json_text", "repeated"]
