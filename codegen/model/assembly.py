"""From the plain data of a file or the builder to a checked `Model`, with every problem on the way.

One pass over the sections in the order in which they need each other: constants, parameters, inputs, gravity, bodies,
points, forces, outputs, initial values. A section that is wrong is reported and left out,
so that the others are still read.
"""

from __future__ import annotations

import keyword
import re
import sys
from collections.abc import Iterable, Iterator
from typing import Any, Final

from pydantic import TypeAdapter, ValidationError
from pydantic_core import PydanticCustomError

from . import checks
from .errors import ModelError, Problem, nearest
from .expressions import Binder, Expression, ExpressionError, Number, combine
from .model import GROUND, Body, Joint, JointForce, Model, Output, Parameter, Point, Vector, joint_coordinates
from .positions import Document, Path_, show_path
from .repetition import Instance, Repetition, labels, name_of
from .schema import (
    ENERGIES,
    LATER_SECTIONS,
    RESERVED,
    SECTIONS,
    ZERO,
    BodyEntry,
    Entry,
    Expr,
    JointEntry,
    JointForceEntry,
    OutputEntry,
    ParameterEntry,
    PointEntry,
    explain,
    parse_name,
    repaired,
    seen,
)
from .schema import Vector as VectorType
from .shapes import Inertia, mass_properties

MAX_PROBLEMS: Final = 200

_MODULES: Final = frozenset({"cffi", "codegen", "generated", "numpy", "stdint"})
_C_KEYWORDS: Final = frozenset(
    "auto break case char const continue default do double else enum extern float for goto if inline int long register "
    "restrict return short signed sizeof static struct switch typedef union unsigned void volatile while".split()
)
_REFERENCES: Final = frozenset({"parent", "body", "position", "velocity"})
_EXPRESSION: Final = TypeAdapter(Expr)
_VECTOR: Final[TypeAdapter[Any]] = TypeAdapter(VectorType, config={"arbitrary_types_allowed": True})
_AXES: Final = tuple(tuple(Expression.number(int(i == k)) for i in range(3)) for k in range(3))


_Parts = tuple[Joint, Expression, Vector, Inertia, bool]


class _TooMany(Exception):
    """Enough problems to print."""


def assemble(document: Document) -> Model:
    """The model that a document describes.

    Raises
    ------
    ModelError
        With all problems.
    """
    assembly = _Assembly(document)
    model = None
    try:
        model = assembly.model()
    except _TooMany:
        pass
    except RecursionError:  # bounded depths should prevent it; a deep call stack of the caller may not
        assembly.problems.append(Problem(document.file, 1, 1, "", "expressions nested too deeply"))
    errors = [p for p in assembly.problems if p.severity == "error"]
    if errors or model is None:
        order = sorted(errors, key=lambda p: (p.line or 0, p.column or 0))
        raise ModelError([*order, *(p for p in assembly.problems if p.severity != "error")])
    return model


class _Assembly:
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
        self.allowed: dict[str, dict[str, None]] = {"constants": {}, "parameters": {}, "motion": {}}
        self.broken: set[str] = set()  # bodies that were reported; their coordinates are not known
        self._reported: set[tuple[Any, ...]] = set()
        self._specs: dict[tuple[int, type[Entry]], Any] = {}
        self._repaired: set[int] = set()  # ids of specs with placeholders
        self._keep: list[Entry] = []  # keeps those ids valid
        self._indices: dict[int, list[tuple[Path_, Expression]]] = {}
        self._checked: set[tuple[Expression, str]] = set()
        self._values: dict[Expression, float | str] = {}
        self._bodies: dict[tuple[Any, ...], _Parts] = {}

    # --- problems -----------------------------------------------------------------------------------------------

    def add(self, problem: Problem) -> None:
        if len(self.problems) >= MAX_PROBLEMS:
            message = f"more than {MAX_PROBLEMS} problems; mend these first"
            self.problems.append(Problem(self.document.file, problem.line, problem.column, "", message))
            raise _TooMany
        self.problems.append(problem)

    def report(
        self,
        at: Instance,
        sub: Path_,
        message: str,
        *,
        key: bool = False,
        inside: int | None = None,
        severity: str = "error",
    ) -> None:
        """A problem in an entry; of a repeated one the first repetition is enough."""
        path = (at.key, *sub)
        shown = show_path((*at.section, *self._existing(at.container, path)))
        if at.indices:
            message += " (" + ", ".join(f"{k} = {v}" for k, v in at.indices.items()) + ")"
        problem = self.document.problem(
            at.container, path, message, shown=shown, key=key, inside=inside, severity=severity
        )
        if at.indices:
            mark = (problem.line, problem.column, shown, severity)
            if mark in self._reported:
                return
            self._reported.add(mark)
        self.add(problem)

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
        try:
            result = self.binder(expression, at.indices)
        except ExpressionError as error:
            text = str(expression)
            prefix = "" if error.message.startswith(text) else f"{text}: "
            self.report(at, sub, prefix + error.message, inside=error.column)
            return ZERO
        if (result, scope) not in self._checked:
            if not self._check(result, expression, at, sub, scope):
                return ZERO
            self._checked.add((result, scope))
            self.used |= result.names
        return result

    def _check(self, result: Expression, written: Expression, at: Instance, sub: Path_, scope: str) -> bool:
        allowed = self.allowed[scope]
        unknown = [n for n in sorted(result.names) if n not in allowed]
        for name in unknown:
            if name[:2] in ("q.", "u.") and scope == "motion" and name.split(".")[1] in self.broken:
                continue
            self.report(at, sub, self._unknown(name, scope), inside=self._column(at, sub, name))
        if unknown:
            return False
        if scope != "motion":
            value = self.value(result)
            if isinstance(value, str):
                self.report(at, sub, f"{written} has no finite value at the default parameters: {value}")
                return False
        return True

    def _column(self, at: Instance, sub: Path_, name: str) -> int | None:
        event = self.document.event(at.container, (at.key, *sub))
        match = re.search(rf"(?<![\w.]){re.escape(name)}(?![\w.])", getattr(event, "value", ""))
        return match.start() + 1 if match else None

    def _unknown(self, name: str, scope: str) -> str:
        everything = self.allowed["motion"]
        if name.lower() in ("nan", "inf", "infinity"):
            return f"{name} is no finite number; only finite numbers are allowed"
        if name in everything or name == "t" or (name[:2] in ("q.", "u.") and scope != "motion"):
            kind = "input" if name in self.inputs else "parameter" if name in self.defaults else "motion"
            what = {
                "input": f"input {name!r}",
                "parameter": f"parameter {name!r}",
                "motion": f"{name!r}, which changes with the motion,",
            }[kind]
            may = "numbers and constants" if scope == "constants" else "numbers, constants and parameters"
            return f"{what} is not allowed here; only {may} are"
        if name[:2] in ("q.", "u."):
            what = "coordinate" if name[0] == "q" else "speed"
            names = [n for n in everything if n[:2] == name[:2]]
            joint = [n for n in names if n.startswith(name + ".")]
            if joint:
                return f"{name} has several freedoms; write one of {', '.join(sorted(joint))}"
            return f"unknown {what} {name!r}; the joints of this model have {_some(names)}{nearest(name, names)}"
        known = [*(n for n in self.constants if n[0] != "'"), *(n for n in self.allowed[scope] if n[1:2] != ".")]
        which = "constants written before it" if scope == "constants" else "known here"
        return f"unknown name {name!r}; {which}: {_some(known)}{nearest(name, known)}"

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
            self.report(at, (), f"{name!r} is reserved and cannot name {_a(what)}; choose another name", key=True)
            return False
        taken = self.first_seen.get((space, name))
        if taken is not None:
            self.report(at, (), f"name {name!r} is already taken by {_a(taken)}; each name may be given once", key=True)
            return False
        self.first_seen[space, name] = what
        return True

    def key_name(self, at: Instance, what: str, space: str) -> str | None:
        """Name of an entry from its key, registered."""
        try:
            name = name_of(parse_name(at.key), {**self.constants, **at.indices} if "(" in at.key else {})
        except PydanticCustomError as error:
            self.report(at, (), str(error.message()), key=True)
        except ExpressionError as error:
            self.report(at, (), error.message, key=True)
        else:
            return name if self.new_name(at, name, space, what) else None
        return None

    def reference(self, expression: Expression, at: Instance, sub: Path_) -> str | None:
        try:
            tree = expression.tree
            return name_of(tree, {**self.constants, **at.indices} if tree[0] == "indexed" else {})
        except ExpressionError as error:
            self.report(at, sub, error.message)
            return None

    # --- entries ------------------------------------------------------------------------------------------------

    def section(self, name: str) -> Iterator[Instance]:
        value = self.document.root.get(name)
        if value is None:
            return
        if not isinstance(value, dict):
            self.report(self._top(name), (), f"{seen(value)}; a mapping of names is needed")
            return
        yield from self.repetition.expand(value, (name,))

    def _top(self, name: str) -> Instance:
        return Instance(name, self.document.root.get(name), self.document.root, (), {})

    def spec(self, cls: type[Any], at: Instance) -> Any:
        """The validated structure of an entry, once for all its repetitions; None after problems."""
        key = (id(at.value), cls)
        if isinstance(at.value, dict) and key in self._specs:
            return self._specs[key]
        result = None
        try:
            result = cls.model_validate(at.value)
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

    def scalar(self, at: Instance, sub: Path_, value: Any, scope: str) -> Expression | None:
        try:
            return self.bound(_EXPRESSION.validate_python(value), at, sub, scope)
        except ValidationError as error:
            context = error.errors()[0].get("ctx", {})
            self.report(at, sub, str(context.get("message", error)), inside=context.get("column"))
            return None

    # --- the sections -------------------------------------------------------------------------------------------

    def model(self) -> Model | None:
        root = self.document.root
        if not isinstance(root, dict):
            message = f"{seen(root)}; a model file is a mapping with the keys {', '.join(SECTIONS)}"
            self.add(Problem(self.document.file, *self._start(), "", message))
            return None
        for key in root:
            if key in LATER_SECTIONS:
                self.report(self._top(key), (), f"section {key!r} is not supported yet by this version", key=True)
            elif key not in SECTIONS:
                hint = nearest(key, SECTIONS)
                self.report(self._top(key), (), f"unknown key {key!r}; keys here: {_some(SECTIONS)}{hint}", key=True)
        name = self.model_name()
        self.read_constants()
        parameters = self.read_parameters()
        self.read_inputs()
        self.allowed["parameters"] = dict.fromkeys(self.defaults)
        self.allowed["motion"] = dict.fromkeys([*self.defaults, *self.inputs, "t"])
        gravity = self.read_gravity()
        instances, specs, names = self.read_body_entries()
        bodies = self.build_bodies(instances, specs, names)
        index = {n: i for i, n in enumerate(names)}
        self.add_motion_names(specs, names)
        points = self.read_points(index)
        forces = self.read_forces(index, specs)
        outputs = self.read_outputs(index, points)
        initial = self.read_initial(specs, names)
        if any(p.severity == "error" for p in self.problems):
            return None
        for parameter, at in parameters:
            if parameter.name not in self.used:
                self.report(at, (), f"parameter {parameter.name!r} is not used", key=True, severity="warning")
        for input_ in self.inputs:
            if input_ not in self.used:
                at = self._top("inputs")
                self.report(at, (), f"input {input_!r} is not used", key=True, severity="warning")
        return Model(
            name=name,
            gravity=gravity,
            parameters=tuple(p for p, _ in parameters),
            inputs=tuple(self.inputs),
            bodies=tuple(bodies),
            forces=tuple(forces),
            outputs=tuple(outputs),
            initial_q=initial["q"],
            initial_u=initial["u"],
            warnings=tuple(str(p) for p in self.problems if p.severity == "warning"),
        )

    def _start(self) -> tuple[int | None, int | None]:
        return (None, None) if self.document.file == "builder" else (1, 1)

    def model_name(self) -> str:
        name = self.document.root.get("model")
        allowed = "a lower-case identifier such as four_bar is allowed; it names the generated package"
        if name is None:
            self.report(self._top("model"), (), f"key 'model' is missing; {allowed}")
        elif not isinstance(name, str) or not re.fullmatch("[A-Za-z_][A-Za-z0-9_]*", name):
            self.report(self._top("model"), (), f"{seen(name)} is no name; {allowed}")
        elif keyword.iskeyword(name) or keyword.issoftkeyword(name) or name in _C_KEYWORDS or name in RESERVED:
            self.report(self._top("model"), (), f"{name!r} is a reserved word; {allowed}")
        elif name in sys.stdlib_module_names or name in _MODULES:
            self.report(self._top("model"), (), f"{name!r} is a module that the package would hide; {allowed}")
        return str(name)

    def read_constants(self) -> None:
        for at in self.section("constants"):
            name = self.key_name(at, "constant", "value")
            many = isinstance(at.value, (list, tuple))
            for i, value in enumerate(at.value if many else [at.value]):
                result = self.scalar(at, (i,) if many else (), value, "constants")
                if name is None or result is None:
                    continue
                entry = f"{name}_{i + 1}" if many else name
                if not many or self.new_name(at, entry, "value", "constant"):
                    self.constants[entry] = result.value

    def read_parameters(self) -> list[tuple[Parameter, Instance]]:
        result = []
        for at in self.section("parameters"):
            name = self.key_name(at, "parameter", "value")
            if isinstance(at.value, dict):
                spec = self.spec(ParameterEntry, at)
                unit = spec.unit if spec is not None else ""
                fields = {k: e for k in ("value", "min", "max") if (e := getattr(spec, k, None)) is not None}
                numbers = {k: self.bound(e, at, (k,), "constants").value for k, e in fields.items()}
            else:
                unit = ""
                expression = self.scalar(at, (), at.value, "constants")
                numbers = {} if expression is None else {"value": expression.value}
            if name is None:
                continue
            value = float(numbers.get("value", 0.0))
            low, high = (float(numbers[k]) if k in numbers else None for k in ("min", "max"))
            if low is not None and high is not None and low > high:
                self.report(at, ("min",), f"min {low:g} is above max {high:g}; min may be at most max")
            elif (low is not None and value < low) or (high is not None and value > high):
                message = f"value {value:g} is outside min {_limit(low)} and max {_limit(high)}"
                self.report(at, ("value",), message, severity="warning")
            self.defaults[name] = value
            result.append((Parameter(name, value, unit, low, high), at))
        return result

    def read_inputs(self) -> None:
        value = self.document.root.get("inputs")
        if value is None:
            return
        if not isinstance(value, (list, tuple)):
            self.report(self._top("inputs"), (), f"{seen(value)}; a list of names is needed: [motor, brake]")
            return
        for i, item in enumerate(value):
            if isinstance(item, dict):
                entries = list(self.repetition.expand(item, ("inputs", i)))
            else:
                entries = [Instance(str(item), None, {}, ("inputs", i), {})]
            for at in entries:
                if at.value is not None:
                    self.report(at, (), f"{seen(at.value)} after an input's name; an input has no value in the model")
                # a plain name of the list has its place in the list
                place = at if isinstance(item, dict) else _InList("inputs", None, self.document.root, (), {}, i)
                name = self._input_name(at, place, item)
                if name is not None:
                    self.inputs.append(name)

    def _input_name(self, at: Instance, place: Instance, item: Any) -> str | None:
        sub: Path_ = (place.item,) if isinstance(place, _InList) else ()
        try:
            tree = parse_name(at.key if isinstance(item, (str, dict)) else item)
            name = name_of(tree, {**self.constants, **at.indices})
        except PydanticCustomError as error:
            self.report(place, sub, str(error.message()))
            return None
        except ExpressionError as error:
            self.report(place, sub, error.message)
            return None
        if name in RESERVED:
            self.report(place, sub, f"{name!r} is reserved and cannot name an input; choose another name")
        elif ("value", name) in self.first_seen:
            taken = self.first_seen["value", name]
            self.report(place, sub, f"name {name!r} is already taken by {_a(taken)}; each name may be given once")
        else:
            self.first_seen["value", name] = "input"
            return name
        return None

    def read_gravity(self) -> Vector | None:
        value = self.document.root.get("gravity")
        if value is None:
            return None
        at = self._top("gravity")
        if not isinstance(value, (list, tuple)) or len(value) != 3:
            self.report(at, (), f"{seen(value)}; three numbers are needed: [x, y, z], m/s^2 in the ground frame")
            return None
        x, y, z = (self.scalar(at, (i,), v, "parameters") or ZERO for i, v in enumerate(value))
        return None if x is ZERO and y is ZERO and z is ZERO else (x, y, z)

    # --- bodies -------------------------------------------------------------------------------------------------

    def read_body_entries(self) -> tuple[list[Instance], list[BodyEntry | None], list[str]]:
        instances, specs, names = [], [], []
        for at in self.section("bodies"):
            name = self.key_name(at, "body", "body")
            spec = self.spec(BodyEntry, at)
            if name is not None:
                instances.append(at)
                specs.append(spec)
                names.append(name)
        if not names and not self.problems:
            at = self._top("bodies")
            message = (
                "no bodies; a model has at least one, such as arm: {parent: ground, joint: {type: revolute, axis: y}}"
            )
            self.report(at, (), message)
        return instances, specs, names

    def build_bodies(self, instances: list[Instance], specs: list[BodyEntry | None], names: list[str]) -> list[Body]:
        """The bodies; those that could not be read are left out, after their report."""
        index = {n: i for i, n in enumerate(names)}
        index["ground"] = GROUND
        bodies: list[Body] = []
        sound: list[tuple[Instance, Body]] = []
        parents = [GROUND] * len(names)
        is_tree = True
        for i, (at, spec, name) in enumerate(zip(instances, specs, names, strict=True)):
            if spec is None:
                continue
            parent = self.body_index(spec.parent, at, ("parent",), index)
            if parent == i:
                self.report(at, ("parent",), f"body {name!r} is its own parent; another body or ground is allowed")
            elif parent is not None:
                parents[i] = parent
            is_tree = is_tree and parent is not None and parent != i
            joint, mass, com, inertia, is_sound = self.body_parts(spec, at)
            bodies.append(Body(name, parents[i], joint, mass, com, inertia))
            if is_sound:
                sound.append((at, bodies[-1]))
        for cycle in checks.cycles(parents):
            is_tree = False
            circle = [names[i] for i in cycle]
            chain = " -> ".join([*circle, circle[0]]) if len(circle) <= 8 else _some(circle)
            message = f"the parents form a circle, {chain}; one of them must lead to ground"
            self.report(instances[cycle[0]], ("parent",), message)
        for found in checks.check_inertia([b for _, b in sound], self.numeric):
            self.report_finding(sound[found[0]][0], found)
        if is_tree and len(sound) == len(names):
            for found in checks.check_freedoms(bodies, self.numeric):
                self.report_finding(instances[found[0]], found)
        return bodies

    def report_finding(self, at: Instance, found: checks.Finding) -> None:
        _, sub, message, severity = found
        if sub[0] not in at.value:
            sub = ("shape",) if "shape" in at.value else ()
        self.report(at, sub, message, severity=severity)

    def body_index(self, reference: Expression, at: Instance, sub: Path_, index: dict[str, int]) -> int | None:
        name = self.reference(reference, at, sub)
        if name is None:
            return None
        found = index.get(name)
        if found is None:
            names = [n for n in index if n != "ground"]
            hint = nearest(name, index)
            if at.indices and sub == ("parent",):
                hint = "; for the first repetition write first: {parent: ground}"
            self.report(at, sub, f"unknown body {name!r}; ground or one of {_some(names)} is allowed{hint}")
        return found

    def body_parts(self, spec: BodyEntry, at: Instance) -> _Parts:
        """Joint, mass properties and whether they are sound; the same objects where the indices used are equal."""
        listed = self._indices.get(id(spec))
        if listed is None:
            listed = self._indices[id(spec)] = list(_expressions(spec))
        used = set().union(*(e.names for _, e in listed)) if at.indices else set()
        key = (id(spec), *((i, v) for i, v in at.indices.items() if i in used))
        found = self._bodies.get(key)
        if found is None:
            found = self._bodies[key] = self._body_parts(spec, at, listed)
        return found

    def _body_parts(self, spec: BodyEntry, at: Instance, listed: list[tuple[Path_, Expression]]) -> _Parts:
        before = len(self.problems)
        result = {sub: self.bound(e, at, sub, "parameters") for sub, e in listed}
        sound = (
            len(self.problems) == before and id(spec) not in self._repaired
        )  # names and values; the joint is checked for itself

        def vector(*sub: str | int) -> Vector:
            return tuple(result.get((*sub, i), ZERO) for i in range(3))  # type: ignore[return-value]

        joint = self.joint(spec.joint, at, vector, result)
        if spec.mass is not None or spec.shape is None:
            com = vector("com") if spec.com is not None else (ZERO, ZERO, ZERO)
            keys = ("xx", "yy", "zz", "xy", "xz", "yz")
            inertia: Any = tuple(result.get(("inertia", k), ZERO) for k in keys)
            return joint, result.get(("mass",), ZERO), com, inertia, sound
        for what in ("length", "radius"):
            if ("shape", what) in result:
                self._check_size(result["shape", what], at, ("shape", what))
        for i in range(3):
            if ("shape", "size", i) in result:
                self._check_size(result["shape", "size", i], at, ("shape", "size", i))
        if ("shape", "axis", 0) in result and all(self.numeric(e) == 0 for e in vector("shape", "axis")):
            self.report(at, ("shape", "axis"), "the axis is zero; a direction is needed: x, y, z or [x, y, z]")
        sound = sound and len(self.problems) == before
        nothing: _Parts = (joint, ZERO, (ZERO, ZERO, ZERO), (ZERO,) * 6, False)
        if not sound:
            return nothing
        try:
            mass, _, inertia6 = mass_properties(spec.shape)
            bound = [self.binder(e, at.indices) for e in (mass, *inertia6)]
        except ExpressionError as error:
            self.report(at, ("shape",), error.message)
            return nothing
        for e in bound:
            if isinstance(why := self.value(e), str):
                self.report(at, ("shape",), f"no finite mass properties at the default parameters: {why}")
                return nothing
        six: Any = tuple(bound[1:])
        return joint, bound[0], vector("shape", "center"), six, True

    def _check_size(self, size: Expression, at: Instance, sub: Path_) -> None:
        if self.numeric(size) < 0:
            self.report(at, sub, f"{checks.with_value(size, self.numeric(size))} is negative; a size is at least 0")

    def joint(self, spec: JointEntry, at: Instance, vector: Any, result: dict[Path_, Expression]) -> Joint:
        axes: list[Vector] = []
        if hasattr(spec, "axis"):
            axes = [vector("joint", "axis")]
        elif hasattr(spec, "axes"):
            axes = [vector("joint", "axes", i) for i in range(2)]
        for i, axis in enumerate(axes):
            sub = ("joint", "axis") if hasattr(spec, "axis") else ("joint", "axes", i)
            self.direction(axis, at, sub)
        if len(axes) == 2:
            a, b = ([self.numeric(e) for e in axis] for axis in axes)
            product = sum(x * y for x, y in zip(a, b, strict=True))
            lengths = (sum(x * x for x in a) * sum(x * x for x in b)) ** 0.5
            if abs(product) > 1e-9 * lengths:
                cosine = product / lengths
                message = (
                    f"the two axes have cosine {cosine:.3g}; those of a universal joint are perpendicular (to 1e-9)"
                )
                self.report(at, ("joint", "axes"), message)
        rotation: list[tuple[Vector, Expression]] = []
        for i in range(len(spec.rotate or ())):
            axis = vector("joint", "rotate", i, "axis")
            self.direction(axis, at, ("joint", "rotate", i, "axis"))
            rotation.append((axis, result["joint", "rotate", i, "angle"]))
        if spec.rpy is not None:
            # fixed axes x, y, z by roll, pitch, yaw: the moving axes z, y, x in turn
            rotation = [(_AXES[k], result["joint", "rpy", k]) for k in (2, 1, 0)]  # type: ignore[misc]
        return Joint(spec.type, tuple(axes), vector("joint", "at"), tuple(r for r in rotation if r[1] is not ZERO))  # type: ignore[attr-defined]

    def direction(self, axis: Vector, at: Instance, sub: Path_) -> None:
        if all(self.numeric(e) == 0 for e in axis):
            message = "the axis is zero at the default parameters; a direction is needed: x, y, z or [x, y, z]"
            self.report(at, sub, message)

    def add_motion_names(self, specs: list[BodyEntry | None], names: list[str]) -> None:
        for spec, name in zip(specs, names, strict=True):
            if spec is not None:
                for prefix, group in zip("qu", joint_coordinates(name, spec.joint.type), strict=True):
                    self.allowed["motion"].update(dict.fromkeys(f"{prefix}.{n}" for n in group))
            if spec is None or id(spec) in self._repaired:
                self.broken.add(name)

    # --- points, forces, outputs --------------------------------------------------------------------------------

    def read_points(self, index: dict[str, int]) -> dict[str, Point]:
        result: dict[str, Point] = {}
        for at in self.section("points"):
            name = self.key_name(at, "point", "point")
            if name in index:
                message = f"{name!r} is a body already; outputs name points and bodies alike, choose another name"
                self.report(at, (), message, key=True)
            spec = self.spec(PointEntry, at)
            if spec is not None and name is not None:
                point = self.point(name, spec, at, (), index)
                if point is not None:
                    result[name] = point
        return result

    def point(self, name: str, spec: PointEntry, at: Instance, sub: Path_, index: dict[str, int]) -> Point | None:
        body = self.body_index(spec.body, at, (*sub, "body"), {**index, "ground": GROUND})
        x, y, z = (self.bound(e, at, (*sub, "at", i), "parameters") for i, e in enumerate(spec.at))
        return None if body is None else Point(name, body, (x, y, z))

    def read_forces(self, index: dict[str, int], specs: list[BodyEntry | None]) -> list[JointForce]:
        result = []
        for at in self.section("forces"):
            name = self.key_name(at, "force", "force")
            spec = self.spec(JointForceEntry, at)
            if spec is None:
                continue
            values = tuple(self.bound(e, at, ("value", i), "motion") for i, e in enumerate(spec.value))
            joint = self.reference(spec.joint, at, ("joint",))
            if joint is None:
                continue
            if joint not in index:
                known = f"a joint has the name of its body: {_some(index)}{nearest(joint, index)}"
                self.report(at, ("joint",), f"unknown joint {joint!r}; {known}")
                continue
            body = specs[index[joint]]
            if body is None:
                continue
            type_ = body.joint.type
            freedoms = joint_coordinates(joint, type_)[1]
            if id(spec) in self._repaired or id(body) in self._repaired:
                continue
            if len(values) != len(freedoms):
                needed = f"{len(freedoms)} are needed, for {', '.join('u.' + n for n in freedoms)}"
                needed = needed if freedoms else "a fixed joint takes no force"
                self.report(at, ("value",), f"{_values(len(values))} for the {type_} joint {joint!r}; {needed}")
            elif name is not None:
                result.append(JointForce(name, index[joint], values))
        return result

    def read_outputs(self, index: dict[str, int], points: dict[str, Point]) -> list[Output]:
        result = []
        for at in self.section("outputs"):
            name = self.key_name(at, "output", "output")
            if not isinstance(at.value, dict):
                if at.value in ENERGIES:
                    if name is not None:
                        result.append(Output(name, str(at.value)))
                else:
                    known = f"{' or '.join(ENERGIES)}, or a mapping such as {{position: tip, axis: z}}, is allowed"
                    hint = nearest(at.value, ENERGIES) if isinstance(at.value, str) else ""
                    self.report(at, (), f"{seen(at.value)}; {known}{hint}")
                continue
            spec = self.spec(OutputEntry, at)
            if spec is None:
                continue
            if spec.value is not None:
                expression = self.bound(spec.value, at, ("value",), "motion")
                if name is not None:
                    result.append(Output(name, "value", expression=expression))
                continue
            measure = "position" if spec.position is not None else "velocity"
            x, y, z = (self.bound(e, at, ("axis", i), "parameters") for i, e in enumerate(spec.axis))
            self.direction((x, y, z), at, ("axis",))
            point = self._output_point(getattr(spec, measure), name or "", at, measure, index, points)
            if name is not None and point is not None:
                result.append(Output(name, measure, point, (x, y, z)))
        return result

    def _output_point(
        self, spec: Any, name: str, at: Instance, measure: str, index: dict[str, int], points: dict[str, Point]
    ) -> Point | None:
        if isinstance(spec, PointEntry):
            return self.point(name, spec, at, (measure,), index)
        target = self.reference(spec, at, (measure,))
        if target is None:
            return None
        if target in points:
            return points[target]
        if target in index:
            return Point(target, index[target], (ZERO, ZERO, ZERO))
        if ("point", target) not in self.first_seen:  # a point that is there but wrong has been reported
            known = [*points, *index]
            message = f"unknown point {target!r}; a point or a body is allowed: {_some(known)}{nearest(target, known)}"
            self.report(at, (measure,), message)
        return None

    # --- initial values -----------------------------------------------------------------------------------------

    def read_initial(self, specs: list[BodyEntry | None], names: list[str]) -> dict[str, dict[str, Expression]]:
        result: dict[str, dict[str, Expression]] = {"q": {}, "u": {}}
        initial = self.document.root.get("initial")
        if initial is None:
            return result
        if not isinstance(initial, dict):
            self.report(self._top("initial"), (), f"{seen(initial)}; a mapping with the keys q, u is needed")
            return result
        groups = {"q": {}, "u": {}}  # type: dict[str, dict[str, tuple[str, ...]]]
        quaternions = []
        for spec, name in zip(specs, names, strict=True):
            if spec is not None:
                q, u = joint_coordinates(name, spec.joint.type)
                groups["q"][name], groups["u"][name] = q, u
                if f"{name}.qw" in q:
                    quaternions.append(name)
        places: dict[str, tuple[Instance, Path_]] = {}
        for part, section in initial.items():
            if part not in result:
                at = Instance(part, section, initial, ("initial",), {})
                self.report(at, (), f"unknown key {part!r}; keys here: q, u", key=True)
            elif section is not None and not isinstance(section, dict):
                at = Instance(part, section, initial, ("initial",), {})
                self.report(at, (), f"{seen(section)}; a mapping of joints to values is needed")
            elif section is not None:
                for at in self.repetition.expand(section, ("initial", part)):
                    self._initial_value(at, part, groups[part], result[part], places)
        for name in quaternions:
            self._normalise(name, result["q"], places)
        return result

    def _initial_value(
        self,
        at: Instance,
        part: str,
        groups: dict[str, tuple[str, ...]],
        result: dict[str, Expression],
        places: dict[str, tuple[Instance, Path_]],
    ) -> None:
        what = "coordinate" if part == "q" else "speed"
        try:
            numbers = {**self.constants, **at.indices} if "(" in at.key else {}
            name = name_of(parse_name(at.key, prefix=f"{part}."), numbers)[2:]
        except PydanticCustomError as error:
            self.report(at, (), str(error.message()), key=True)
            return
        except ExpressionError as error:
            self.report(at, (), error.message, key=True)
            return
        entries = groups.get(name)
        if entries is None:
            if name.partition(".")[0] in self.broken:
                return
            owner = groups.get(name.rpartition(".")[0], ())
            if name not in owner:
                known = list(dict.fromkeys([n for g in groups.values() for n in g] + list(groups)))
                message = f"unknown {what} {name!r}; allowed are {_some(known)}{nearest(name, known)}"
                self.report(at, (), message, key=True)
                return
            entries = (name,)
        if isinstance(at.value, (list, tuple)):
            values = [((i,), v) for i, v in enumerate(at.value)]
        else:
            values = [((), at.value)]  # type: ignore[list-item]
        if len(values) != len(entries) and name in self.broken:
            return
        if len(values) != len(entries):
            message = f"{_values(len(values))}; joint {name!r} has {len(entries)}: {', '.join(entries) or 'none'}"
            self.report(at, (), message)
            return
        for entry, (sub, value) in zip(entries, values, strict=True):
            if entry in places and entry in result:
                self.report(at, (), f"{what} {entry!r} is given already; each may be given once", key=True)
                continue
            expression = self.scalar(at, sub, value, "parameters")
            if expression is not None:
                result[entry] = expression
                places[f"{part}.{entry}"] = places[entry] = (at, sub)

    def _normalise(self, name: str, values: dict[str, Expression], places: dict[str, tuple[Instance, Path_]]) -> None:
        keys = [f"{name}.q{c}" for c in "wxyz"]
        given = [k for k in keys if k in values]
        if not given:
            return
        parts = [values.get(k, Expression.number(int(k.endswith("w")))) for k in keys]
        length = sum(self.numeric(e) ** 2 for e in parts) ** 0.5
        at = places[given[0]][0]
        if abs(length - 1) > 1e-3:
            message = f"the quaternion {name}.qw qx qy qz has length {length:.6g}; 1 is needed (to 1e-3)"
            self.report(at, (), message)
        elif abs(length - 1) > 1e-12:
            message = f"the quaternion {name}.qw qx qy qz has length {length:.12g}, not 1, and was normalised"
            self.report(at, (), message, severity="warning")
            w, x, y, z = (_square(e) for e in parts)
            norm = combine("sqrt", combine("+", combine("+", w, x), combine("+", y, z)))
            for key, part in zip(keys, parts, strict=True):
                values[key] = Expression(combine("/", part.tree, norm))


class _InList(Instance):
    """An item of a list, reported at its place there."""

    __slots__ = ("item",)

    def __init__(self, key: str, value: Any, container: Any, section: Path_, indices: Any, item: int) -> None:
        super().__init__(key, value, container, section, indices)
        self.item = item


def _square(e: Expression) -> Any:
    return combine("*", e.tree, e.tree)


def _expressions(entry: Entry, sub: Path_ = ()) -> Iterator[tuple[Path_, Expression]]:
    """The expressions of an entry with their paths, references left out."""
    for key, value in entry:
        if key not in _REFERENCES:
            yield from _expressions_in(value, (*sub, key))


def _expressions_in(value: Any, sub: Path_) -> Iterator[tuple[Path_, Expression]]:
    if isinstance(value, Expression):
        yield sub, value
    elif isinstance(value, Entry):
        yield from _expressions(value, sub)
    elif isinstance(value, tuple):
        for i, item in enumerate(value):
            yield from _expressions_in(item, (*sub, i))


def _a(what: str) -> str:
    return f"an {what}" if what[0] in "aeiou" else f"a {what}"


def _values(count: int) -> str:
    return f"{count} value" + "s" * (count != 1)


def _limit(value: float | None) -> str:
    return "(none)" if value is None else f"{value:g}"


def _some(names: Iterable[str]) -> str:
    """The first names of many."""
    listed = list(names)
    text = ", ".join(listed[:12])
    return (f"{text}, ... ({len(listed)} in all)" if len(listed) > 12 else text) or "(none)"
