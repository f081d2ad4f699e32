"""What every section needs while it is read: problems with their places, bound and checked expressions, names.

A `Reader` holds the state of one reading. The modules of `sections` are functions that take it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from typing import Any, Final

from pydantic import TypeAdapter, ValidationError
from pydantic_core import PydanticCustomError

from .axes import Vector
from .entries import RESERVED, ZERO, Entry, Expr, parse_name, seen
from .errors import Problem, nearest, with_article, within_a_line
from .explaining import explain, repaired, validate
from .expressions import MEASURED, Binder, Expression, ExpressionError, Number, Numbers, Scope, Tree
from .positions import Document, Path_, show_path
from .rates import with_names_replaced
from .repetition import Instance, Repetition, labels, name_of

MAX_PROBLEMS: Final = 200
MAX_ERRORS: Final = 10_000
"""So many errors are counted, those of repetitions that are not said again included."""

_EXPRESSION: Final = TypeAdapter(Expr)


ALLOWED: Final = {
    "constants": "numbers and constants",
    "parameters": "numbers, constants and parameters",
    "inputs": "numbers, constants, parameters, inputs and t",
    "motion": "numbers, constants, parameters, inputs, t, q.NAME and u.NAME",
}
"""What may stand in expressions of a scope, in words."""


class TooManyProblems(Exception):
    """Enough problems to print."""


def is_measured(name: str) -> bool:
    """Whether a name is the position or velocity of a point."""
    return name.startswith(tuple(f"{what}." for what in MEASURED))


class Reader:
    """One reading of one document.

    Attributes
    ----------
    problems : list of Problem
    constants : dict of str to number
        With the labels of repetitions, see `labels`.
    defaults : dict of str to float
        Values of the parameters.
    inputs : list of str
    used : set of str
        Names that expressions have.
    allowed : dict of str to dict
        Names that expressions of a scope may have: ``constants``, ``parameters``, ``inputs`` (parameters, inputs and t)
        or ``motion`` (coordinates and speeds too). A scope ``measured`` has, beside the last, positions and velocities of points.
    points : list of mapping
        What is a point, by name, once points are read.
    prescribed : dict of str to Tree
        What is put in the place of coordinates and speeds that are prescribed: functions of time.
    broken : set of str
        Bodies that were reported; their coordinates are not known.
    places : dict of str to dict of str to (int, int)
        Line and column of entries by section and name.
    errors : int
        How often an error was reported, those of repeated entries that were said before included: as long as it stays,
        what was read is sound.
    """

    def __init__(self, document: Document) -> None:
        self.document = document
        self.problems: list[Problem] = list(document.problems)
        self.constants: dict[str, Number | str] = dict(labels(document.root))
        self.binder = Binder(self.constants)
        self.repetition = Repetition(document, self.add, self.constants)
        self.defaults: dict[str, float] = {}
        self.inputs: list[str] = []
        self.used: set[str] = set()
        self.first_seen: dict[tuple[str, str], str] = {}
        # dicts used as ordered sets: names are printed in the order of the file
        self.allowed: dict[str, dict[str, None]] = {"constants": {}, "parameters": {}, "inputs": {}, "motion": {}}
        self.broken: set[str] = set()
        self.prescribed: dict[str, Tree] = {}
        self.points: list[Mapping[str, Any]] = []
        self.errors = 0
        self.places: dict[str, dict[str, tuple[int | None, int | None]]] = {}
        self._key_places: dict[tuple[int, str], tuple[int | None, int | None]] = {}
        self._reported: set[tuple[Any, ...]] = set()
        self._specs: dict[tuple[int, int], Any] = {}
        self.bound_once: dict[tuple[int, Path_], dict[Path_, Expression]] = {}
        """Bound expressions of validated entries that no repeat index changes; see `placement.bound_expressions`."""
        self._repaired: set[int] = set()  # ids of specs with placeholders
        self._keep: list[Entry] = []  # keeps those ids valid
        self._checked: set[tuple[Expression, str]] = set()
        self._values: dict[Expression, float | str] = {}

    # --- problems -----------------------------------------------------------------------------------------------

    def add(self, problem: Problem) -> None:
        if problem.severity == "error" and sum(p.severity == "error" for p in self.problems) >= MAX_PROBLEMS:
            message = f"more than {MAX_PROBLEMS} problems; mend these first"
            self.problems.append(Problem(self.document.file, problem.line, problem.column, "", message))
            raise TooManyProblems
        self.problems.append(problem)

    def report(
        self,
        at: Instance,
        sub: Path_,
        message: str | Callable[[], str],
        *,
        key: bool = False,
        inside: int | None = None,
        severity: str = "error",
    ) -> None:
        """A problem in an entry; of a repeated one the first repetition is enough.

        A message that takes long to make, such as one with the nearest of many names, is given as a function.
        """
        self.errors += severity == "error"
        path = (at.key, *sub)
        shown = show_path((*at.section, *self._existing(at.container, path)))
        line, column = self.document.place(at.container, path, key=key, inside=inside)
        if self.errors > MAX_ERRORS:
            message = f"more than {MAX_ERRORS} mistakes with those that repetitions repeat; mend these first"
            self.problems.append(Problem(self.document.file, line, column, shown, message))
            raise TooManyProblems
        if at.indices:
            mark = (line, column, shown, severity)
            if mark in self._reported:
                return
            self._reported.add(mark)
        text = message if isinstance(message, str) else message()
        if at.indices:
            text += " (" + ", ".join(f"{k} = {v}" for k, v in at.indices.items()) + ")"
        self.add(Problem(self.document.file, line, column, shown, within_a_line(text), severity))

    @staticmethod
    def _existing(container: Any, path: Path_) -> Path_:
        """The parts of a path that lead to something written."""
        result: list[str | int] = []
        for part in path:
            listed = isinstance(container, (list, tuple)) and isinstance(part, int) and part < len(container)
            if listed or (isinstance(container, dict) and part in container):
                container = container[part]
                result.append(part)
        return tuple(result)

    # --- expressions and names ----------------------------------------------------------------------------------

    def bound(self, expression: Expression, at: Instance, sub: Path_, scope: str) -> Expression:
        """The expression with constants and indices as numbers, its names checked; 0 after a problem."""
        if expression.tree[0] == "number":
            return expression
        try:
            result = self.binder(expression, at.indices)
        except ExpressionError as error:
            text = str(expression)
            prefix = "" if error.message.startswith(text) else f"{text}: "
            self.report(at, sub, prefix + error.message, inside=error.column)
            return ZERO
        if result.tree[0] != "number" and (result, scope) not in self._checked:
            if not self._check(result, expression, at, sub, scope):
                return ZERO
            self._checked.add((result, scope))
            self.used |= result.names
        return with_names_replaced(result, self.prescribed) if self.prescribed else result

    def _check(self, result: Expression, written: Expression, at: Instance, sub: Path_, scope: str) -> bool:
        moving = scope in ("motion", "measured")
        allowed = self.allowed["motion" if moving else scope]
        unknown = [n for n in sorted(result.names) if n not in allowed]
        if scope == "measured":
            unknown = [
                n for n in unknown if not (is_measured(n) and any(n.split(".")[1] in known for known in self.points))
            ]
        for name in unknown:
            if name[:2] in ("q.", "u.") and moving and name.split(".")[1] in self.broken:
                continue
            if is_measured(name) and scope == "measured" and ("point", name.split(".")[1]) in self.first_seen:
                continue  # a point that is there but wrong has been reported
            self.report(at, sub, partial(self._unknown, name, scope), inside=self._column(at, sub, name))
        if unknown:
            return False
        if not moving and result.names <= self.defaults.keys():
            value = self.value(result)
            if isinstance(value, str):
                self.report(at, sub, f"{written} has no finite value at the default parameters: {value}")
                return False
        return True

    def _column(self, at: Instance, sub: Path_, name: str) -> int | None:
        value: Any = at.container
        for part in self._existing(value, (at.key, *sub)):
            value = value[part]
        if not isinstance(value, str):
            return None
        start = value.find(name)
        while start >= 0:  # no regular expression: compiling one for each of many names takes longest
            end = start + len(name)
            around = value[max(start - 1, 0) : start] + value[end : end + 1]
            if not any(c.isalnum() or c in "_." for c in around):
                return start + 1
            start = value.find(name, end)
        return None

    def _unknown(self, name: str, scope: str) -> str:
        everything = self.allowed["motion"]
        if name.lower() in ("nan", "inf", "infinity"):
            return f"{name} is no finite number; only finite numbers are allowed"
        if is_measured(name):
            return self._not_measured(name, scope)
        if name in everything or name == "t" or (name[:2] in ("q.", "u.") and scope not in ("motion", "measured")):
            kind = "input" if name in self.inputs else "parameter" if name in self.defaults else "motion"
            what = {
                "input": f"input {name!r}",
                "parameter": f"parameter {name!r}",
                "motion": f"{name!r}, which changes with the motion,",
            }[kind]
            return f"{what} is not allowed here; only {ALLOWED[scope]} are"
        if name[:2] in ("q.", "u."):
            what = "coordinate" if name[0] == "q" else "speed"
            names = [n for n in everything if n[:2] == name[:2]]
            joint = [n for n in names if n.startswith(name + ".")]
            if joint:
                return f"{name} has several freedoms; write one of {', '.join(sorted(joint))}"
            hint = self.loop_hint(name[2:]) or nearest(name, names)
            return f"unknown {what} {name!r}; the joints of this model have {some(names)}{hint}"
        those = self.allowed["motion" if scope == "measured" else scope]
        known = [*(n for n in self.constants if n[0] != "'"), *(n for n in those if n[1:2] != ".")]
        which = "constants written before it" if scope == "constants" else "known here"
        return f"unknown name {name!r}; {which}: {some(known)}{nearest(name, known)}"

    def _not_measured(self, name: str, scope: str) -> str:
        """What is wrong with the position or velocity of a point."""
        if scope != "measured":
            return (
                f"{name!r}, which changes with the motion, is not allowed here; only {ALLOWED[scope]} are; positions and "
                f"velocities of points may stand in forces on bodies that have no potential energy"
            )
        point, known = name.split(".")[1], [n for names in self.points for n in names]
        return f"unknown point {point!r} in {name}; a point or a body is allowed: {some(known)}{nearest(point, known)}"

    def loop_hint(self, name: str) -> str:
        """``; 'foot' closes a loop, ...`` where a loop is taken for a joint with coordinates, or nothing."""
        loop = name.partition(".")[0]
        is_loop = self.first_seen.get(("body", loop)) == "loop"
        return f"; {loop!r} closes a loop, and such a joint has no coordinates" if is_loop else ""

    def value(self, expression: Expression) -> float | str:
        """Value at the default parameters, or why there is none."""
        found = self._values.get(expression)
        if found is None:
            try:
                found = float(expression.evaluate(self.defaults))
                if found != found or found in (float("inf"), float("-inf")):
                    found = str(found)
            except ZeroDivisionError:
                found = "division by zero"
            except OverflowError:
                found = "too large a number"
            except (ArithmeticError, ValueError):
                found = "a function outside its domain"
            self._values[expression] = found
        return found

    def numeric(self, expression: Expression) -> float:
        value = self.value(expression)
        return 0.0 if isinstance(value, str) else value

    def new_name(self, at: Instance, name: str, space: str, what: str) -> bool:
        """Register a name in its namespace; False after a problem."""
        if name in RESERVED:
            self.report(
                at, (), f"{name!r} is reserved and cannot name {with_article(what)}; choose another name", key=True
            )
            return False
        taken = self.first_seen.get((space, name))
        if taken is not None:
            self.report(
                at,
                (),
                f"name {name!r} is already taken by {with_article(taken)}; each name may be given once",
                key=True,
            )
            return False
        self.first_seen[space, name] = what
        return True

    def key_name(self, at: Instance, what: str, space: str) -> str | None:
        """Name of an entry from its key, registered."""
        try:
            name = name_of(parse_name(at.key), self.numbers(at))
        except PydanticCustomError as error:
            self.report(at, (), str(error.message()), key=True)
        except ExpressionError as error:
            self.report(at, (), error.message, key=True)
        else:
            if self.new_name(at, name, space, what):
                self.places.setdefault(str(at.section[0]), {})[name] = self._key_place(at)
                return name
        return None

    def _key_place(self, at: Instance) -> tuple[int | None, int | None]:
        """Place of an entry's key; one object for all its repetitions."""
        key = id(at.container), at.key
        found = self._key_places.get(key)
        if found is None:
            found = self._key_places[key] = self.document.place(at.container, (at.key,), key=True)
        return found

    def numbers(self, at: Instance) -> Numbers:
        """The constants and repeat indices that an entry may use."""
        return Scope(at.indices, self.constants) if at.indices else self.constants

    def reference(self, expression: Expression, at: Instance, sub: Path_) -> str | None:
        try:
            return name_of(expression.tree, self.numbers(at))
        except ExpressionError as error:
            self.report(at, sub, error.message)
            return None

    # --- entries ------------------------------------------------------------------------------------------------

    def section(self, name: str) -> Iterator[Instance]:
        value = self.document.root.get(name)
        if value is None:
            return
        if not isinstance(value, dict):
            self.report(self.top(name), (), f"{seen(value)}; a mapping of names is needed")
            return
        yield from self.repetition.expand(value, (name,))

    def listed(self, name: str, example: str) -> Iterator[tuple[Instance, Path_, Any]]:
        """The names of a section that is a list: where to report each, with the path there, and what is written."""
        value = self.document.root.get(name)
        if value is None:
            return
        if not isinstance(value, (list, tuple)):
            self.report(self.top(name), (), f"{seen(value)}; a list of names is needed: {example}")
            return
        for i, item in enumerate(value):
            if not isinstance(item, dict):
                yield self.top(name), (i,), item
                continue
            for at in self.repetition.expand(item, (name, i)):
                if at.value is not None:
                    self.report(at, (), f"{seen(at.value)} after a name; the names of this list have no value")
                yield at, (), at.key

    def top(self, name: str) -> Instance:
        return Instance(name, self.document.root.get(name), self.document.root, (), {})

    def spec(self, cls: Any, at: Instance) -> Any:
        """The validated structure of an entry, once for all its repetitions; None after problems."""
        key = (id(at.value), id(cls))
        if isinstance(at.value, dict) and key in self._specs:
            return self._specs[key]
        result = None
        try:
            result = validate(cls, at.value)
        except ValidationError as error:
            for sub, message, at_key, column in explain(cls, error):
                self.report(at, sub, message, key=at_key, inside=column)
            result = repaired(cls, at.value, error)
            if result is not None:
                self._repaired.add(id(result))
                self._keep.append(result)
        if isinstance(at.value, dict):
            self._specs[key] = result
        return result

    def is_whole(self, spec: Entry | None) -> bool:
        """Whether a structure is there and was right as written, without placeholders for what was wrong."""
        return spec is not None and id(spec) not in self._repaired

    def scalar(self, at: Instance, sub: Path_, value: Any, scope: str) -> Expression | None:
        try:
            return self.bound(_EXPRESSION.validate_python(value), at, sub, scope)
        except ValidationError as error:
            context = error.errors()[0].get("ctx", {})
            self.report(at, sub, str(context.get("message", error)), inside=context.get("column"))
            return None

    def direction(self, axis: Vector, at: Instance, sub: Path_) -> None:
        """Report an axis that is zero, or whose length cannot be computed."""
        largest = max(abs(self.numeric(e)) for e in axis)
        if largest == 0:
            message = "the axis is zero at the default parameters; a direction is needed: x, y, z or [x, y, z]"
            self.report(at, sub, message)
        elif not 1e-100 < largest < 1e100:
            message = (
                f"the axis has a length of about {largest:.2g}, whose square is no number of this machine; "
                f"only its direction counts: give it a length between 1e-100 and 1e100"
            )
            self.report(at, sub, message)


def some(names: Iterable[str]) -> str:
    """The first names of many."""
    listed = list(names)
    text = ", ".join(listed[:12])
    return (f"{text}, ... ({len(listed)} in all)" if len(listed) > 12 else text) or "(none)"
