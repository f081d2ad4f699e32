"""Services for reading sections: errors with places, bound and checked expressions, and names.

A `Reader` holds the state of reading one model. The modules of `sections` are functions that receive it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from typing import Any, Final

from pydantic import TypeAdapter, ValidationError
from pydantic_core import PydanticCustomError

from . import entries
from .axes import Vector
from .binding import Numbers, Scope, vector_key
from .entries import RESERVED, ZERO, Entry, Expr, parse_name, shown
from .errors import with_article
from .explaining import explain, repaired, validate
from .expressions import Expression, compares, has_factors
from .grammar import ExpressionError, Tree
from .parsing import parse
from .parts import Files, Instance, Part
from .positions import Document, Path_
from .problems import Problems
from .rates import with_names_replaced
from .repetition import Counter, Repetition, labels, name_of
from .slopes import regular
from .surfaces import COORDINATES
from .units import Dimension, DimensionError, Frequency, dimension_of, misfit
from .unknown_names import column_of, is_measured, unknown_name
from .wanted_units import IN_JOINTS, dimension_of_unit, unit_wanted

_EXPRESSION: Final = TypeAdapter(Expr)
_VECTOR: Final = TypeAdapter(entries.Vector)


SWITCHED = ("expressions", "forces", "motion", "outputs")
"""Sections whose expressions may change branches without a warning, because motions locate these changes."""


class Reader(Problems):
    """The state of reading one model, and services for the sections.

    Attributes
    ----------
    parts : list of Part
        The files of the model: its own first, each file before those that it uses.
    own : Part
        The model's own file.
    defaults : dict of str to float
        Default values of the parameters.
    inputs : list of str
    used : set of str
        Names that occur in expressions.
    allowed : dict of str to dict
        Names allowed in expressions by scope: ``constants``, ``parameters``, ``inputs`` (parameters, inputs and t) or
        ``motion`` (also coordinates and speeds). The scope ``measured`` adds positions and velocities of points to
        ``motion``; the scope ``equations`` adds the coordinates of a point to the parameters.
    points : list of mapping
        Mappings of the points by name, once the points have been read.
    prescribed : dict of str to Tree
        Functions of time that replace prescribed coordinates and speeds.
    units_of_motion : dict of (str, str) to tuple of str
        Units of coordinates (``q``) and speeds (``u``) of a joint, or of a single one, by name.
    broken : set of str
        Bodies with reported errors; their coordinates are not known.
    places : dict of str to dict of str to (int, int)
        Line and column of entries by section and name.
    """

    def __init__(self, document: Document, folder: str | None = None) -> None:
        super().__init__(document)
        self.files = Files(document, folder)
        self._counter = Counter()
        self._repetitions: dict[int, Repetition] = {}
        self.parts: list[Part] = []
        self.own = self.added(Part(document))
        self.defaults: dict[str, float] = {}
        self.inputs: list[str] = []
        self.used: set[str] = set()
        self.first_seen: dict[tuple[str, str], str] = {}
        # dicts used as ordered sets: messages list names in the order of the file
        self.allowed: dict[str, dict[str, None]] = {"constants": {}, "parameters": {}, "inputs": {}, "motion": {}}
        self.allowed["equations"] = self.allowed["parameters"]  # the coordinates of a point are added later
        self.broken: set[str] = set()
        self.prescribed: dict[str, Tree] = {}
        self.units_of_motion: dict[tuple[str, str], tuple[str, ...]] = {}
        self.points: list[Mapping[str, Any]] = []
        self.places: dict[str, dict[str, tuple[str, int | None, int | None]]] = {}
        self._key_places: dict[tuple[int, str], tuple[str, int | None, int | None]] = {}
        self._specs: dict[tuple[int, int], Any] = {}
        self.bound_once: dict[tuple[int, int, Path_], dict[Path_, Expression]] = {}
        """Expressions, with their names bound, of validated entries that are equal for all values of a repeat index; see
        `placement.bound_expressions`."""
        self._repaired: set[int] = set()  # ids of entries in which placeholders replace wrong values
        self._keep: list[Entry] = []  # these entries, kept since the ids of deleted objects would be reused
        self._checked: set[tuple[Expression, str]] = set()
        self._regular: set[Tree] = set()  # trees that `regular` does not change, which long models repeat
        self._values: dict[Expression, float | str] = {}

    def added(self, part: Part) -> Part:
        """Add a file, and return it."""
        part.constants.update(labels(part.document.root))
        self._repetitions[id(part)] = Repetition(part, self.add, self._counter)
        self.parts.append(part)
        return part

    def expand(self, part: Part, section: dict[str, Any], path: Path_) -> Iterator[Instance]:
        """Entries of a section of a file; the entries of a repeat block come one repetition after the other."""
        return self._repetitions[id(part)].expand(section, path)

    # --- expressions and names ----------------------------------------------------------------------------------

    def bound(self, expression: Expression, at: Instance, sub: Path_, scope: str) -> Expression:
        """The expression with constants and indices as numbers and with its names checked; 0 after an error."""
        if expression.tree[0] == "number":
            return expression
        try:
            result = at.part.bound(expression, at.indices)
            if result.tree not in self._regular:
                tree = regular(result.tree)
                if tree is result.tree:
                    self._regular.add(tree)
                else:
                    result = Expression(tree)
        except ExpressionError as error:
            text = str(expression)
            prefix = "" if error.message.startswith((text, repr(text))) else f"{text}: "
            if not _is_said(expression):
                self.report(at, sub, prefix + error.message, inside=error.column)
            return ZERO
        if (expression.has_units or at.part.dimensions) and not self._fits(expression, at, sub):
            return ZERO
        if result.tree[0] != "number" and (result, scope) not in self._checked:
            if not self._check(result, expression, at, sub, scope):
                return ZERO
            self._checked.add((result, scope))
            self.used |= result.names
            if (at.section or ("",))[0] not in SWITCHED and compares(result.tree):
                message = (
                    f"{expression} jumps at a change of branch; derivatives are those of the branch taken; "
                    f"step(x, from, to) is smooth"
                )
                self.report(at, sub, message, severity="warning")
        return with_names_replaced(result, self.prescribed) if self.prescribed else result

    def _fits(self, expression: Expression, at: Instance, sub: Path_) -> bool:
        """Whether the units of an expression agree with the dimension that is required at its place."""
        found = self.dimension(expression, at, sub)
        wanted = self.unit_wanted(at, sub)
        angular = isinstance(found, Frequency) and wanted == found  # 1/s is required of angular rates only
        if found is None or wanted is None or (found == wanted and not angular):
            return True
        message = misfit(expression.tree, str(expression), found, wanted)
        if angular:
            message += "; write rev/s for turns per second, or rad/s"
        elif has_factors(expression.tree):
            message += "; a number without a unit counts as a factor, so give it a unit"
        if not _is_said(expression):
            self.report(at, sub, message)
        return False

    def dimension(self, expression: Expression, at: Instance, sub: Path_ = (), quiet: bool = False) -> Dimension | None:
        """The dimension of an expression as far as units determine it; None after an error, which `quiet`
        suppresses."""
        try:
            return dimension_of(expression.tree, at.part.dimensions)
        except DimensionError as error:
            if not quiet and not _is_said(expression):
                self.report(at, sub, f"{expression}: {error}")
            return None

    def unit_wanted(self, at: Instance, sub: Path_) -> Dimension | None:
        """The dimension that the value at a path must have; None if any is allowed."""
        section = str(at.section[0]) if at.section else at.key
        if section in ("initial", "motion"):
            part = str(at.section[1]) if section == "initial" else "q"
            unit = self.units_of_motion.get((part, at.part.name(at.key)), ())
            place = sub[0] if sub and isinstance(sub[0], int) else 0
            return dimension_of_unit(unit[place] or "rad") if place < len(unit) else None
        if section == "forces" and isinstance(at.value, dict) and str(at.value.get("type")) in IN_JOINTS:
            speeds = self.units_of_motion.get(("u", at.part.name(str(at.value.get("joint")))), ())
            place = sub[1] if len(sub) > 1 and isinstance(sub[1], int) else 0
            units = IN_JOINTS[at.value["type"]].get(str(sub[0]))
            if units is None or place >= len(speeds):
                return None
            return dimension_of_unit(units[speeds[place] == "m/s"])
        return unit_wanted(section, sub, at.value)

    def _check(self, result: Expression, written: Expression, at: Instance, sub: Path_, scope: str) -> bool:
        moving = scope in ("motion", "measured")
        allowed = self.allowed["motion" if moving else scope]
        unknown = [n for n in sorted(result.names) if n not in allowed]
        if scope == "equations":
            unknown = [n for n in unknown if n not in COORDINATES]
        if scope == "measured":
            unknown = [
                n for n in unknown if not (is_measured(n) and any(n.split(".")[1] in known for known in self.points))
            ]
        if scope != "measured":  # of several positions and velocities, only the first is reported
            several = [n for n in unknown if is_measured(n)]
            unknown = [n for n in unknown if n not in several[1:]]
        for name in [] if _is_said(written) else unknown:
            if name[:2] in ("q.", "u.") and moving and name.split(".")[1] in self.broken:
                continue
            if is_measured(name) and scope == "measured" and ("point", name.split(".")[1]) in self.first_seen:
                continue  # a point with errors has been reported
            self.report(at, sub, partial(unknown_name, self, name, scope, at), inside=column_of(at, sub, name))
        if unknown:
            return False
        if not moving and result.names <= self.defaults.keys():
            value = self.value(result)
            if isinstance(value, str):
                self.report(at, sub, f"{written} has no finite value at the default parameters: {value}")
                return False
        return True

    def loop_hint(self, name: str) -> str:
        """The hint ``; 'foot' closes a loop, ...`` if a loop is taken for a joint with coordinates; otherwise empty."""
        loop = name.partition(".")[0]
        is_loop = self.first_seen.get(("body", loop)) == "loop"
        return f"; {loop!r} closes a loop, and such a joint has no coordinates" if is_loop else ""

    def value(self, expression: Expression) -> float | str:
        """Value at the default parameters, or the reason why there is none."""
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

    def new_name(self, at: Instance, name: str, space: str, what: str, sub: Path_ = (), key: bool = True) -> bool:
        """Register a name in its namespace; False after an error, which is reported at the path or at the `key` there."""
        if name in RESERVED:
            message = f"{name!r} is reserved and cannot name {with_article(what)}; choose another name"
            self.report(at, sub, message, key=key)
            return False
        taken = self.first_seen.get((space, name))
        if taken is not None:
            message = f"name {name!r} is already taken by {with_article(taken)}; choose another name"
            self.report(at, sub, message, key=key)
            return False
        self.first_seen[space, name] = what
        return True

    def key_name(self, at: Instance, what: str, space: str) -> str | None:
        """The registered name of an entry, from its key."""
        local = self.name_at(at, (), at.key, key=True)
        if local is None or not self.new_name(at, at.part.name(local), space, what):
            return None
        name = at.part.name(local)
        self.places.setdefault(str(at.section[0]), {})[name] = self.key_place(at)
        return name

    def local_name(self, at: Instance) -> str:
        """The name, as in the file, of an entry whose key has been read."""
        return name_of(parse_name(at.key), self.numbers(at))

    def name_at(
        self, at: Instance, sub: Path_, written: Any, key: bool = False, prefix: str = "", quiet: bool = False
    ) -> str | None:
        """The name, as in the file, that a text or an expression denotes after its indices have been replaced.

        Errors are reported at a path or, with `key`, at the key of this path; with `quiet` they are not reported. After
        an error, the result is None. `prefix`, such as ``q.``, is put before a text.
        """
        try:
            tree = written.tree if isinstance(written, Expression) else parse_name(written, prefix=prefix)
            return name_of(tree, self.numbers(at))
        except PydanticCustomError as error:
            message = str(error.message())
        except ExpressionError as error:
            message = error.message
        if not quiet:
            self.report(at, sub, message, key=key)
        return None

    def key_place(self, at: Instance) -> tuple[str, int | None, int | None]:
        """File and place of an entry's key; one object for all its repetitions."""
        key = id(at.container), at.key
        found = self._key_places.get(key)
        if found is None:
            document = at.part.document
            found = self._key_places[key] = (document.file, *document.place(at.container, (at.key,), key=True))
        return found

    def given(self, at: Instance, name: str, scope: str) -> tuple[Expression, ...] | None:
        """The expressions that the using model gives for a number of a submodel; None if it gives none.

        One expression, or three for a vector.
        """
        given = at.part.given.get(name)
        if given is None:
            return None
        given.used = True
        path = ("with", given.key)
        is_vector = isinstance(at.value, (list, tuple)) or (
            isinstance(at.value, dict) and isinstance(at.value.get("value"), list)
        )
        if scope != "inputs" and is_vector:
            found = self.vector(given.at, path, given.value, scope, "[x, y, z], as the submodel has it") or (
                ZERO,
                ZERO,
                ZERO,
            )
            at.part.constants[vector_key(name)] = name
            at.part.values.update({f"{name}.{c}": e.tree for c, e in zip("xyz", found, strict=True)})
            return found
        one = self.scalar(given.at, path, given.value, scope) or ZERO
        at.part.values[name] = one.tree
        try:
            written = _EXPRESSION.validate_python(given.value)
        except ValidationError:
            return (one,)  # errors in the value have been reported where it was bound
        dimension = self.dimension(written, given.at, path, quiet=True)
        if dimension is not None:
            at.part.dimensions[name] = dimension
        return (one,)

    def given_entry(self, at: Instance, scope: str) -> tuple[Expression, ...] | None:
        """The expressions that `given` returns, for an entry and its key."""
        if not at.part.given:
            return None
        name = self.name_at(at, (), at.key, quiet=True)  # an error in the name is reported where the name is read
        return None if name is None else self.given(at, name, scope)

    def numbers(self, at: Instance) -> Numbers:
        """The constants and repeat indices that an entry may use."""
        return Scope(at.indices, at.part.constants) if at.indices else at.part.constants

    def reference(self, expression: Expression, at: Instance, sub: Path_) -> str | None:
        name = self.name_at(at, sub, expression)
        return None if name is None else at.part.referred(name)

    def coordinate(self, written: Any, at: Instance, sub: Path_, key: bool = False, of: str = "q") -> str | None:
        """The coordinate (or speed, with ``of="u"``) of a text such as ``q.NAME``, without prefix; None after an
        error."""
        name = self.name_at(at, sub, written, key, f"{of}.")
        return None if name is None else at.part.name(name[2:])

    # --- entries ------------------------------------------------------------------------------------------------

    def section(self, name: str, parts: Iterable[Part] | None = None) -> Iterator[Instance]:
        """The entries of a section in all files, or in some."""
        for part in self.parts if parts is None else parts:
            value = part.document.root.get(name)
            if value is None:
                continue
            if not isinstance(value, dict):
                self.report(part.entry(name), (), f"{shown(value)}; a mapping of names is needed")
                continue
            yield from self.expand(part, value, (name,))

    def entries(self, name: str, cls: Any, what: str, space: str) -> Iterator[tuple[Instance, str | None, Any]]:
        """The entries of a section with their registered names and validated structures; None for those with errors."""
        for at in self.section(name):
            yield at, self.key_name(at, what, space), self.spec(cls, at)

    def listed(self, name: str, example: str) -> Iterator[tuple[Instance, Path_, Any]]:
        """The names in a section that is a list: the entry to report, the path in it, and the text."""
        for part in self.parts:
            value = part.document.root.get(name)
            if value is None:
                continue
            if not isinstance(value, (list, tuple)):
                self.report(part.entry(name), (), f"{shown(value)}; a list of names is needed: {example}")
                continue
            for i, item in enumerate(value):
                if not isinstance(item, dict):
                    yield part.entry(name), (i,), item
                    continue
                for at in self.expand(part, item, (name, i)):
                    if at.value is not None:
                        self.report(at, (), f"{shown(at.value)} after a name; the names of this list have no value")
                    yield at, (), at.key

    def only(self, name: str) -> Instance | None:
        """A top-level key that occurs in at most one file of the model."""
        found = [
            part.entry(name) for part in self.parts if not part.is_submodel and part.document.root.get(name) is not None
        ]
        for at in found[1:]:
            self.report(
                at, (), f"{name} is already given in {found[0].part.document.file}; only one file may have it", key=True
            )
        return found[0] if found else None

    def top(self, name: str) -> Instance:
        return self.own.entry(name)

    def spec(self, cls: Any, at: Instance) -> Any:
        """The validated structure of an entry, made once for all its repetitions; None after errors."""
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
        """Whether an entry exists and none of its values was wrong (a placeholder replaces a wrong value)."""
        return spec is not None and id(spec) not in self._repaired

    def parsed(self, at: Instance, sub: Path_, value: Any) -> Expression | None:
        """The expression at a path; None after an error."""
        if type(value) is str:
            try:
                return parse(value)
            except ExpressionError:
                pass  # the validation below reports the error, as for other values
        try:
            found: Expression = _EXPRESSION.validate_python(value)
            return found
        except ValidationError as error:
            context = error.errors()[0].get("ctx", {})
            self.report(at, sub, str(context.get("message", error)), inside=context.get("column"))
            return None

    def scalar(self, at: Instance, sub: Path_, value: Any, scope: str) -> Expression | None:
        """The bound expression at a path; None after an error."""
        found = self.parsed(at, sub, value)
        return None if found is None else self.bound(found, at, sub, scope)

    def numbers_at(self, at: Instance, sub: Path_, value: Any) -> list[tuple[Path_, Expression]]:
        """The expression at a path, or the three expressions of a vector, each with its path; not yet bound."""
        listed = [((*sub, i), v) for i, v in enumerate(value)] if isinstance(value, (list, tuple)) else [(sub, value)]
        if len(listed) not in (1, 3) or (len(listed) == 1 and isinstance(value, (list, tuple))):
            self.report(at, sub, f"{shown(value)}; a number, or three for a vector, is needed")
            return []
        return [(path, self.parsed(at, path, one) or ZERO) for path, one in listed]

    def vector(
        self, at: Instance, sub: Path_, value: Any, scope: str, wanted: str
    ) -> tuple[Expression, Expression, Expression] | None:
        """The three bound expressions of a vector, which is a list or a vector expression."""
        if isinstance(value, str):
            try:
                parts = _VECTOR.validate_python(value)
            except ValidationError:
                parts = None
            if parts is not None:
                x, y, z = (self.bound(e, at, sub, scope) for e in parts)
                return x, y, z
        if not isinstance(value, (list, tuple)) or len(value) != 3:
            self.report(at, sub, f"{shown(value)}; three numbers are needed: {wanted}")
            return None
        x, y, z = (self.scalar(at, (*sub, i), v, scope) or ZERO for i, v in enumerate(value))
        return x, y, z

    def direction(self, axis: Vector, at: Instance, sub: Path_) -> None:
        """Report an axis that is zero, or whose length cannot be computed."""
        largest = max(abs(self.numeric(e)) for e in axis)
        if largest == 0:
            message = "the axis is zero at the default parameters; a direction is needed: x, y, z or [x, y, z]"
            self.report(at, sub, message)
        elif not 1e-100 < largest < 1e100:
            message = (
                f"the axis has a length of about {largest:.2g}, whose square is not a finite double; "
                f"only its direction counts: give it a length between 1e-100 and 1e100"
            )
            self.report(at, sub, message)


def _is_said(expression: Expression) -> bool:
    """Whether errors about names have been reported for the first of three components."""
    return bool(expression.tree[0] == "component" and expression.tree[2] > 0)
