"""The functions of a C header: the lines of a procedure's steps, their memory, declarations, and loops over batches.

The struct ``c`` has the values of a call, ``d`` those per direction; the latter is initialised before the first step over
directions. Routines get a pointer ``a`` to one of the two. Arrays are pointers in these structs, to the caller's memory or
to the workspace.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from ...program import procedure as steps
from ...program.procedure import Array, Procedure, Routine, Step, over_directions, stops
from ...program.store import MODES
from ..function import Function, called_with
from ..runs import name_of
from ..target import Scalar
from .call_memory import Memory, lays_out, read_apart
from .columns import all_columns, primitives
from .libraries import guard, guard_of_width


def symbol(procedure: Procedure, width: int | None = None) -> str:
    """Name of a function in C, without the name of the model."""
    return f"{procedure.name}_{width}" if width else procedure.name


def parameters(procedure: Procedure, real: str) -> list[str]:
    """Declarations of the parameters; `real` is the scalar type."""
    found = [f"{real} {a.name}" if not a.shape else f"const {real} *{a.name}" for a in procedure.arguments]
    found += [f"const {real} *{a.name}" for a in procedure.seeds]
    return [*found, *(f"{real} *{a.name}" for a in procedure.results), f"{real} *work"]


def parameters_in_modes(procedure: Procedure, real: str) -> list[str]:
    """Declarations of the parameters of the variant of a function that takes modes."""
    assert procedure.modes is not None
    *rest, work = parameters(procedure, real)
    return [*rest, f"const {real} *{procedure.modes.name}", work]


def in_modes(name: str) -> str:
    """Name of the variant of a function that takes modes."""
    return f"{name}_in_modes"


def signature(procedure: Procedure, name: str, real: str, modes: bool = False) -> str:
    """Declaration of a C function, without the semicolon."""
    return called_with(f"int {name}(", (parameters_in_modes if modes else parameters)(procedure, real))


def signatures(procedure: Procedure, model: str, real: str) -> list[str]:
    """Declarations of a function for all its widths, without and with modes."""
    found = []
    for w in procedure.widths or (None,):
        if procedure.modes is None or not procedure.internal:
            found.append(signature(procedure, f"{model}_{symbol(procedure, w)}", real))
        if procedure.modes is not None:
            name = f"{model}_{in_modes(procedure.name)}"
            found.append(signature(procedure, f"{name}_{w}" if w else name, real, True))
    return found


def in_all(number: str) -> str:
    """The C text of a number; if a scalar holds several states, the text sets this number for every state."""
    return f"ALL({number})"


def batch_signature(procedure: Procedure, model: str, width: int | None = None) -> str:
    """Declaration of the loop over a batch, without the semicolon."""
    return f"int {model}_{symbol(procedure, width)}_batch({model}_batch *b)"


def batch_line(procedure: Procedure, width: int | None) -> str:
    """The line that calls the macro ``BATCH``, which contains the common lines of all loops over a batch."""
    arrays = (*procedure.arguments, *procedure.seeds, *procedure.results)
    passed = [f"AT({a.name})" if a.shape or a.lanes else f"*AT({a.name})" for a in arrays]
    return called_with(f"BATCH({symbol(procedure, width)}, ", [*passed, "b->work"])


def batch_lines(procedures: Iterable[tuple[Procedure, int | None]]) -> dict[str, list[str]]:
    """Declarations of functions of several widths, grouped by the condition for their compilation."""
    found: dict[str, list[str]] = {}
    for procedure, width in procedures:
        found.setdefault(guard_of_width(procedure.name, width), []).append(batch_line(procedure, width))
    return found


def batch_arrays(procedures: Iterable[Procedure]) -> tuple[list[str], list[str]]:
    """Arrays in the struct of a batch, in order: first arrays that are only read, then arrays that a function
    writes."""
    procedures = list(procedures)
    written = dict.fromkeys(r.name for p in procedures for r in p.results)
    given = dict.fromkeys(a.name for p in procedures for a in (*p.arguments, *p.seeds) if a.name not in written)
    return list(given), list(written)


def batch_members(procedures: Iterable[Procedure], read: str, written: str) -> list[tuple[str, list[str]]]:
    """Members of the struct of a batch: types, and lines with names."""
    both = zip((read, written), batch_arrays(procedures), strict=True)
    return [(type_, called_with("", names, ";").split("\n")) for type_, names in both if names]


class CFunctions:
    """Writes procedures and routines as functions in C.

    Parameters
    ----------
    model : str
    scalar : Scalar
    memory : Memory
    prepared : callable (str) -> list of str
        Returns lines for a preparation; see `Prepare`.
    laid_out : callable (Procedure) -> list of str
        Returns lines that give a call its memory, if it needs any.
    """

    def __init__(
        self,
        model: str,
        scalar: Scalar,
        memory: Memory,
        prepared: Callable[[str], list[str]],
        laid_out: Callable[[Procedure], list[str]],
    ):
        self.model, self.scalar = model, scalar
        self.memory = memory
        self.prepared = prepared
        self.laid_out = laid_out
        self.copied: set[str] = set()
        """Members of a call that functions over directions read, without the members that `lay_out` sets."""

    def routine(self, routine: Routine) -> Function:
        """The C function of a routine."""
        inner = Lines(self, None, routine.lanes)
        lines = [line for step in routine.steps for line in inner.of(step)]
        status = any(map(stops, routine.steps))
        name = f"DIRECTIONS({routine.name})" if routine.lanes else routine.name
        type_ = "DIRECTIONS(call)" if routine.lanes else "call"
        head = f"static {'int' if status else 'void'} {name}({type_} *a)"
        return Function(routine.doc, head, [*lines, "return 0;"] if status else lines)

    def function(self, procedure: Procedure) -> Function:
        """A function of the header. A function over directions is for ``WIDTH`` directions, a macro."""
        modes = procedure.modes is not None
        name = f"{self.model}_{in_modes(procedure.name) if modes else procedure.name}"
        head = signature(procedure, f"DIRECTIONS({name})" if procedure.seeds else name, self.scalar.word, modes)
        lines = Lines(self, procedure, False).function()
        return Function(procedure.doc, head, lines, guard=guard(procedure.name, (*procedure.widths, *procedure.apart)))

    def functions(self, procedure: Procedure) -> list[Function]:
        """The functions of the header for one procedure: without modes, and also with modes where needed."""
        found = [self.function(procedure)]
        if procedure.modes is None or procedure.internal:
            return found
        plain, held = (f"{self.model}_{n}" for n in (procedure.name, in_modes(procedure.name)))
        if procedure.seeds:
            plain, held = f"DIRECTIONS({plain})", f"DIRECTIONS({held})"
        *given, work = [p.rpartition(" ")[2].lstrip("*") for p in parameters(procedure, self.scalar.word)]
        call = called_with(f"return {held}(", [*given, "0", work], ");")
        doc = "The same function, with each switch in the branch that its arguments select."
        return [
            *found,
            Function(doc, signature(procedure, plain, self.scalar.word), call.split("\n"), guard=found[0].guard),
        ]


class Lines:
    """Writes the lines of one function, or of one routine."""

    takes_modes = True
    """Whether the function passes modes of switches to sweeps. If its procedure takes none, it passes a null pointer."""

    def __init__(self, of: CFunctions, procedure: Procedure | None, lanes: bool):
        self.functions = of
        self.memory = of.memory
        self.procedure = procedure
        self.lanes = lanes
        self.opened = False

    # -- names -----------------------------------------------------------------------------------------------------

    def passed(self, lanes: bool) -> str:
        """The argument that is passed to a sweep or a routine."""
        return "a" if self.procedure is None else "&d" if lanes else "&c"

    def base(self, lanes: bool) -> str:
        return "a->" if self.procedure is None else "d." if lanes else "c."

    def array(self, a: Array) -> str:
        """The C expression of an array."""
        if self.apart(a):
            return f"((LANES *){a.name})" if a.lanes else a.name
        return f"{self.base(a.lanes)}{a.name}"

    def apart(self, a: Array) -> bool:
        """Whether an array is a result that no sweep writes, so that it is only a parameter of the function."""
        p = self.procedure
        return p is not None and a in p.results and a.name in p.written_apart()

    def caller(self, a: Array, written: bool) -> str:
        """The expression of an array that the caller passes: a parameter that is a pointer."""
        if a.lanes:
            return f"({'' if written else 'const '}LANES *){a.name}"
        is_const = self.procedure is not None and a in self.procedure.arguments
        return f"({self.functions.scalar.word} *){a.name}" if written and is_const else a.name

    # -- a function of the header ----------------------------------------------------------------------------------

    def function(self) -> list[str]:
        before, after = self.body()
        copied = self.opened or any("open_" in line for line in before)
        return [*self.head(copied, self.opened), *before, *after, *self.end()]

    def body(self) -> tuple[list[str], list[str]]:
        """The lines of all steps: before the first step over directions, and from there on."""
        p = self.procedure
        assert p is not None
        before: list[str] = []
        after: list[str] = []
        for step in p.steps:
            if over_directions(step) and not self.opened:
                after += self.open()
            (after if self.opened else before).extend(self.of(step))
        if p.steps and isinstance(p.steps[-1], steps.Check):
            (after if self.opened else before).pop()
        return before, after

    def head(self, copied: bool, along: bool) -> list[str]:
        """Lines that declare the structs of a call, over directions if `along`, and give the call its memory."""
        p = self.procedure
        assert p is not None
        values = {**self.bound(p.arguments), **self.bound_results(False)}
        if p.modes is not None and self.takes_modes:
            values[p.modes.name] = p.modes.name
        head = self.begun(values, copied)
        if along:
            head.append("DIRECTIONS(call) d;")
        if any(isinstance(s, steps.Single) and s.steps for s in p.steps):
            head.append("call_1 one;")
        return [*head, *self.functions.laid_out(p)]

    def begun(self, values: dict[str, str], copied: bool) -> list[str]:
        """Lines that declare the struct of a call with the values of its members; if `copied`, the struct over
        directions."""
        p = self.procedure
        assert p is not None
        members = [*self.memory.fields, *self.memory.numbers]
        if not lays_out(p):
            given = [f".{name} = {values[name]}" for name in members if name in values]  # C++ requires this order
            return called_with("call c = {", given or ["0"], "};").split("\n")
        # an initializer would set the whole struct to zero, which takes as long as a sweep over a few links
        set_anyway = {MODES.name, *(self.functions.copied if copied else ())}
        read = [name for name in members if name in values or name in set_anyway]
        given = [f"c.{name} = {values.get(name, 0)}" for name in read]
        return ["call c;", *(called_with("", given, ";").split("\n") if given else [])]

    def end(self) -> list[str]:
        """The ``return`` statement of a function of the header."""
        p = self.procedure
        assert p is not None
        last = p.steps[-1] if p.steps else None
        return [f"return {self.base(last.lanes)}singular;" if isinstance(last, steps.Check) else "return 0;"]

    def bound(self, given: tuple[Array, ...]) -> dict[str, str]:
        """Arrays of the call that are arguments or seeds of the function."""
        p = self.procedure
        assert p is not None
        held = p.held()
        found = {}
        for a in given:
            name = held[a.name].name if a.name in held else a.name
            if not a.shape and not a.lanes:
                found[name] = a.name
            elif not read_apart(p, a):
                fields = self.memory.lane_fields if a.lanes else self.memory.fields
                found[name] = self.caller(a, fields[name])
        return found

    def bound_results(self, lanes: bool) -> dict[str, str]:
        """Arrays of the call that are results of the function."""
        p = self.procedure
        assert p is not None
        apart = p.written_apart()
        return {r.name: self.caller(r, True) for r in p.results if r.lanes == lanes and r.name not in apart}

    def open(self) -> list[str]:
        """Lines that initialise the struct for values per direction."""
        p = self.procedure
        assert p is not None
        self.opened = True
        values = {**self.bound(p.seeds), **self.bound_results(True)}
        return ["DIRECTIONS(open)(&d, &c, work);", *(f"{self.base(True)}{name} = {x};" for name, x in values.items())]

    # -- steps -----------------------------------------------------------------------------------------------------

    def of(self, step: Step) -> list[str]:
        """Lines of C for one step of a procedure."""
        match step:
            case steps.Run():
                return [self.call(step.sweep, step.lanes)]
            case steps.Formulas():
                return [self.call(step.called, step.lanes)]
            case steps.Prepare():
                return self.functions.prepared(step.what)
            case steps.Perform():
                return self.perform(step)
            case steps.Check():
                if self.procedure is None:
                    return ["if (STOPPED(a)) return 1;"]
                singular = f"{self.base(step.lanes)}singular"
                return [f"if ({singular}) return {singular};"]
            case steps.Tolerate():
                return []
            case steps.Own():
                if not step.array.size:
                    return []
                return [f"{self.base(step.array.lanes)}{step.array.name} = {self.own(step.array)};"]
            case steps.Hold():
                return [*self.of(steps.Own(step.array)), *self.of(steps.Copy(step.array, step.given))]
            case steps.Bind():
                return [f"{self.base(step.array.lanes)}{step.array.name} = {self.bound_to(step.to)};"]
            case steps.Zero():
                return self.each(step.array.size, f"{self.array(step.array)}[i] = {self.nothing(step.array)};")
            case steps.Copy():
                return self.each(step.to.size, f"{self.array(step.to)}[i] = {self.array(step.of)}[i];")
            case steps.CopyEntry():
                return [f"{self.array(step.to)}[{step.index}] = {self.array(step.of)}[{step.entry}];"]
            case steps.AddEntry():
                to, of = f"{self.array(step.to)}[{step.index}]", f"{self.array(step.of)}[{step.entry}]"
                return [f"EACH_VECTOR {to}.at[h] += {of}.at[h];" if step.to.lanes else f"{to} += {of};"]
            case steps.ZeroEntries():
                return self.zero_entries(step)
            case steps.Combine():
                return self.combine(step)
            case steps.Single():
                return self.single(step)
            case steps.Columns():
                return self.columns(step) if step.unit.lanes else self.columns_of_values(step)
            case steps.AllColumns():
                return all_columns(step, self.array, self.functions.scalar)
            case steps.Primitives():
                return primitives(step, self.array, self.call(step.formulas.called, True), self.functions.scalar)
            case steps.IfAsked():
                asked = " || ".join(self.array(r) for r in step.results)
                lines = [f"    {line}" for s in step.steps for line in self.of(s)]
                return [f"if ({asked}) {{", *lines, "}"] if lines else []
            case steps.Together():
                raise TypeError("chosen_steps.for_target must choose one of the two forms before printing")

    def number(self, text: str) -> str:
        """The C literal of a number."""
        return self.functions.scalar.literal(text)

    def nothing(self, a: Array) -> str:
        """Lines that set entries of an array to zero."""
        return "NOTHING" if a.lanes else in_all(self.number("0.0"))

    def call(self, name: str, lanes: bool) -> str:
        return f"{f'DIRECTIONS({name})' if lanes else name}({self.passed(lanes)});"

    def perform(self, step: steps.Perform) -> list[str]:
        call = self.call(step.routine.name, step.routine.lanes)
        if not stops(step):
            return [call]
        return [f"if ({call.removesuffix(';')}) return {self.base(step.routine.lanes)}singular;"]

    @staticmethod
    def each(n: int, line: str) -> list[str]:
        """A line for each entry; none if there are no entries."""
        return [f"for (int i = 0; i < {n}; ++i) {line}"] if n else []

    def own(self, a: Array) -> str:
        place = f"{self.base(a.lanes)}own + {self.memory.own[a]}"
        return f"(LANES *)({place})" if a.lanes else place

    def bound_to(self, a: Array) -> str:
        if self.apart(a):
            return self.caller(a, True)
        return self.array(a)

    def combine(self, step: steps.Combine) -> list[str]:
        h = ".at[h]" if step.to.lanes else ""
        terms = " + ".join(f"{self.array(a)}[i]{h}" for a in step.plus)
        terms += "".join(f" - {self.array(a)}[i]{h}" for a in step.minus)
        return self.each(
            step.to.size, f"{'EACH_VECTOR ' if step.to.lanes else ''}{self.array(step.to)}[i]{h} = {terms};"
        )

    def zero_entries(self, step: steps.ZeroEntries) -> list[str]:
        a, n = step.array, len(step.entries)
        if not n:
            return []
        table = f"static const int zero_{a.name}[{n}] = {{{', '.join(map(str, step.entries))}}};"
        return [table, *self.each(n, f"{self.array(a)}[zero_{a.name}[i]] = {self.nothing(a)};")]

    def single(self, step: steps.Single) -> list[str]:
        if not step.steps:  # a model without speeds has no such sweeps
            return []
        lines = ["open_1(&one, &c, work);"]
        given = () if self.procedure is None else (*self.procedure.arguments, *self.procedure.results)
        lines += [
            f"one.{a.name} = (lanes_1 *){of.name if of in given else self.array(of)};"
            for a, of in (*step.reads, *step.writes)
        ]
        return [*lines, *(f"{name_of(s)}_1(&one);" for s in step.steps)]

    def columns(self, step: steps.Columns) -> list[str]:
        """Lines that compute one column per direction in each pass."""
        unit, free = step.unit, step.among
        count = unit.size if free is None else len(free)
        at = "j + l" if free is None else f"free_{unit.name}[j + l]"
        takes = [t for t in step.takes if t.into.size]
        lines = []
        if free is not None:
            lines += [
                f"for (long i = 0; i < {t.into.size}L; ++i) {self.array(t.into)}[i] = {self.nothing(t.into)};"
                for t in takes
            ]
        if not count or not takes:
            return lines
        if free is not None:
            lines.insert(0, f"static const int free_{unit.name}[{count}] = {{{', '.join(map(str, free))}}};")
        lines += [
            f"for (int j = 0; j < {count}; j += WIDTH) {{",
            f"    const int m = {count} - j < WIDTH ? {count} - j : WIDTH;",
            f"    for (int l = 0; l < m; ++l) *component({self.array(unit)} + {at}, l) = {self.number('1.0')};",
        ]
        lines += [f"    {line}" for s in step.steps for line in self.of(s)]
        for t in takes:
            rows, columns = t.of.size, t.into.size // t.of.size
            taken = f"*component({self.array(t.of)} + i, l);"
            into = self.array(t.into)
            if t.symmetric:
                lines += [
                    "    for (int l = 0; l < m; ++l)",
                    f"        for (int i = j + l; i < {rows}; ++i)",
                    f"            {into}[{columns}L*i + {at}] = {into}[{columns}L*({at}) + i] = {taken}",
                ]
            else:
                lines += [
                    f"    for (int i = 0; i < {rows}; ++i)",
                    f"        for (int l = 0; l < m; ++l) {into}[{columns}L*i + {at}] = {taken}",
                ]
        return [*lines, f"    for (int l = 0; l < m; ++l) {self.array(unit)}[{at}] = NOTHING;", "}"]

    def columns_of_values(self, step: steps.Columns) -> list[str]:
        """Lines that compute one column of values in each pass, together with its tangents in all directions."""
        if not step.unit.size:
            return []
        unit = self.array(step.unit)
        lines = [f"for (int j = 0; j < {step.unit.size}; ++j) {{", f"    {unit}[j] = {self.number('1.0')};"]
        lines += [f"    {line}" for s in step.steps for line in self.of(s)]
        lines.append(f"    {unit}[j] = {self.number('0.0')};")
        for t in step.takes:
            columns = t.into.size // t.of.size
            line = f"{self.array(t.into)}[{columns}L*i + j] = {self.array(t.of)}[i];"
            lines += [f"    {each}" for each in self.each(t.of.size, line)]
        return [*lines, "}"]
