"""The functions of a NumPy module: a procedure's steps as lines.

All arrays of a call are attributes of ``a``. They are lists of entries, which sweeps replace one by one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field

from ...program import procedure as steps
from ...program.procedure import Array, Procedure, Routine, Step, over_directions
from ...records import dataclass
from ..function import Function

AXES = {"nq": "NQ", "nu": "NU"}
"""Axes of arrays whose lengths are named constants of the module."""

WIDEST = 110
"""Largest number of characters in a line of results."""


def made(procedures: tuple[Procedure, ...]) -> list[Array]:
    """Result arrays that are allocated at the beginning of a call, for sweeps to write."""
    found: dict[Array, None] = {}
    for p in procedures:
        apart = p.written_apart()
        found |= dict.fromkeys(r for r in p.results if r.name not in apart)
    return list(found)


@dataclass(slots=True)
class PublicFunction(Function):
    """A function of the module, with lines that describe arguments and results."""

    takes: list[str] = field(default_factory=list)
    returns: str = ""


class NumpyFunctions:
    """Writes procedures and routines as functions in NumPy.

    Parameters
    ----------
    prepared : callable (str) -> list of str
        Returns lines for a preparation; see `Prepare`.
    pivots : callable (str) -> bool
        Returns whether a sweep checks pivots. Its statements may divide by zero before the zero pivot is reported.
    """

    def __init__(self, prepared: Callable[[str], list[str]], pivots: Callable[[str], bool]):
        self.prepared = prepared
        self.pivots = pivots

    def routine(self, routine: Routine) -> Function:
        inner = _Lines(self, frozenset())
        return Function(routine.doc, f"def {routine.name}(a):", [line for s in routine.steps for line in inner.of(s)])

    def function(self, procedure: Procedure) -> PublicFunction:
        """A function of the NumPy module."""
        p = procedure
        given = (*p.arguments, *p.seeds)
        names = ", ".join(a.name for a in given)
        lines = [f"a = Call({', '.join(f'{a.name}={a.name}' for a in given)})"]
        held = p.held()
        lines += [f"a.{held[a.name].name} = a.{a.name}" for a in given if a.name in held]
        inner = _Lines(self, frozenset(r.name for r in p.results if r.name not in p.written_apart()), p)
        lines += [line for s in p.steps for line in inner.of(s)]
        takes = [", ".join(map(described, arrays)) for arrays in (p.arguments, p.seeds) if arrays]
        returns = ", ".join(map(described, p.results))
        return PublicFunction(
            p.doc, f"def {p.name}({names}):", [*lines, *inner.returned()], takes=takes, returns=returns
        )


def described(a: Array) -> str:
    """Name and axes of an argument or a result."""
    return f"{a.name} ({'k, ' if a.lanes else ''}...{''.join(f', {axis}' for axis in a.shape)})"


def count(a: Array) -> str:
    """Number of entries of an array."""
    return AXES.get(a.shape[0], str(a.size)) if len(a.shape) == 1 else str(a.size)


class _Lines:
    """Writer of the lines of one function; `zero` names the arrays that are still zero."""

    def __init__(self, of: NumpyFunctions, zero: frozenset[str], procedure: Procedure | None = None):
        self.functions = of
        self.procedure = procedure
        self.zero = set(zero)
        self.matrices: set[str] = set()
        self.result_of: dict[str, str] = {}

    def of(self, step: Step) -> list[str]:
        """Lines of Python for one step of a procedure."""
        if isinstance(step, (steps.Run, steps.Formulas, steps.Perform, steps.Single, steps.Columns)):
            self.zero.clear() if over_directions(step) else self.zero.intersection_update(self._of_lanes())
        match step:
            case steps.Run():
                return self.guarded(step.sweep)
            case steps.Formulas():
                return self.guarded(step.called)
            case steps.Prepare():
                return self.functions.prepared(step.what)
            case steps.Perform():
                return [f"{step.routine.name}(a)"]
            case steps.Check():
                return []
            case steps.Tolerate():
                return ["a.solves = False  # residuals of loops are known even where they have lost rank"]
            case steps.Own():
                return self.fresh(step.array)
            case steps.Hold():
                return [f"a.{step.array.name} = list(a.{step.given.name})"]
            case steps.Bind():
                return self.bind(step)
            case steps.Zero():
                return [] if step.array.name in self.zero else self.fresh(step.array)
            case steps.Copy():
                return [f"a.{step.to.name} = list(a.{step.of.name})"]
            case steps.CopyEntry():
                return [f"a.{step.to.name}[{step.index}] = a.{step.of.name}[{step.entry}]"]
            case steps.AddEntry():
                to = f"a.{step.to.name}[{step.index}]"
                return [f"{to} = {to} + a.{step.of.name}[{step.entry}]"]
            case steps.ZeroEntries():
                return self.zero_entries(step)
            case steps.Combine():
                names = [a.name for a in (*step.plus, *step.minus)]
                terms = " + ".join(a.name for a in step.plus) + "".join(f" - {a.name}" for a in step.minus)
                arrays = ", ".join(f"a.{n}" for n in names)
                each = f"zip({arrays})" if len(names) > 1 else arrays
                return [f"a.{step.to.name} = [{terms.strip()} for {', '.join(names)} in {each}]"]
            case steps.Single():
                return self.single(step)
            case steps.Columns():
                return self.columns(step)
            case steps.AllColumns() | steps.Primitives() | steps.IfAsked() | steps.Together():
                raise TypeError("NumPy takes columns one after the other, see chosen_steps.for_target")

    def guarded(self, name: str) -> list[str]:
        """Lines of a call, followed by lines that report a division by a zero pivot."""
        line = f"{name}(a)"
        return ['with np.errstate(all="ignore"):', f"    {line}"] if self.functions.pivots(name) else [line]

    def _of_lanes(self) -> set[str]:
        """Names of the results that are derivatives; a function of values has none."""
        return {r.name for r in self.procedure.results if r.lanes} if self.procedure else set()

    def fresh(self, a: Array) -> list[str]:
        """Statement that fills an array with zeros."""
        self.zero.add(a.name)
        return [f"a.{a.name} = [0.0] * {count(a)}"]

    @staticmethod
    def zero_entries(step: steps.ZeroEntries) -> list[str]:
        if not step.entries:
            return []
        return [f"for i in {list(step.entries)}:", f"    a.{step.array.name}[i] = 0.0"]

    def bind(self, step: steps.Bind) -> list[str]:
        p, to = self.procedure, step.to
        if p is not None and to in p.results and to.name not in self.result_of:
            self.result_of[to.name] = step.array.name
            return self.fresh(step.array)
        return [f"a.{step.array.name} = a.{to.name}"]

    def single(self, step: steps.Single) -> list[str]:
        kept = [a.name for a, _ in step.writes if self.procedure and a in self.procedure.seeds]
        kept = [name for name in kept if self.procedure and name not in self.procedure.held()]
        lines = [f"given_{name} = a.{name}" for name in kept]
        # tangents of formulas overwrite their seeds later
        copied = any(isinstance(s, steps.Formulas) for s in step.steps)
        seeds = [(a.name, of.name) for a, of in step.reads if a.name != of.name]
        lines += [f"a.{a} = list(a.{of})" if copied else f"a.{a} = a.{of}" for a, of in seeds]
        lines += [line for a, _ in step.writes for line in self.fresh(a)]
        lines += [line for s in step.steps for line in self.of(s)]
        self.result_of |= {to.name: to.name for _, to in step.writes}
        lines += [f"a.{to.name} = a.{a.name}" for a, to in step.writes]
        return [*lines, *(f"a.{name} = given_{name}" for name in kept)]

    def columns(self, step: steps.Columns) -> list[str]:
        unit, along = step.unit, any(map(over_directions, step.steps)) and not step.unit.lanes
        lines = []
        for t in step.takes:
            self.matrices.add(t.into.name)
            columns = str(unit.size)
            size = AXES.get(t.into.shape[-1], columns) if len(t.into.shape) > 1 else columns
            lead = "*a.k, *a.batch" if t.into.lanes else "*a.batch"
            lines.append(f"a.{t.into.name} = np.zeros(({lead}, {count(t.of)}, {size}))")
        among = "" if step.among is None else f", among={list(step.among)}"
        lines.append(f"for columns, m, unit in unit_columns(a, {count(unit)}{', a.k' if along else ''}{among}):")
        inner = [f"a.{unit.name} = unit", *(line for s in step.steps for line in self.of(s))]
        for t in step.takes:
            # order of axes: columns, directions, states
            matrix, shape = f"a.{t.into.name}", "(m, *a.k, *a.batch)" if t.into.lanes else "(m, *a.batch)"
            if along and not t.into.lanes:
                matrix, shape = f"a.{t.into.name}[None]", "(m, 1, *a.batch)"
            inner += [
                f"for i, row in enumerate(a.{t.of.name}):",
                f"    set_columns({matrix}, i, columns, row, {shape})",
            ]
        lines += [f"    {line}" for line in inner]
        for t in step.takes:
            if t.symmetric:
                name = f"a.{t.into.name}"
                lines.append(f"{name} = np.tril({name}) + np.swapaxes(np.tril({name}, -1), -1, -2)")
        return [*lines, *self.fresh(unit)]  # reset the unit vector

    def returned(self) -> list[str]:
        """Statement that returns the results."""
        assert self.procedure is not None
        parts = []
        for r in self.procedure.results:
            name = f"a.{self.result_of.get(r.name, r.name)}"
            if r.name in self.matrices:
                parts.append(name if len(r.shape) > 1 else f"{name}[..., 0]")
            else:
                shape = "a.k + a.batch" if r.lanes else "a.batch"
                parts.append(f"result({name}, {shape}){'' if r.shape else '[..., 0]'}")
        line = f"return {', '.join(parts)}" if len(parts) > 1 else f"return ({parts[0]},)"
        return [line] if len(line) <= WIDEST else ["return (", *(f"    {part}," for part in parts), ")"]
