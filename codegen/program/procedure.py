"""Procedures: what the functions of a solver do, step by step, as data.

A procedure takes *arguments* and *seeds* and gives *results*; its steps run sweeps and formulas, which read and write arrays by
name. An array of the name of an argument, a seed or a result lies in the caller's memory unless a step puts it elsewhere. Steps
that several procedures share are a `Routine`. From the same steps every target prints its functions, and operations are counted.

There are no branches: what a model does not have, a procedure does not do.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from ..records import dataclass

WIDTHS = (8, 2, 1)
"""How many directions one call of the sensitivities takes."""

CONSTANTS, ANGLES = "constants", "angles"
GROUND, GROUND_AT_REST = "ground", "ground at rest"
GROUND_TANGENT, GROUND_TANGENT_AT_REST = "tangent of the ground", "tangent of the ground at rest"
GROUND_TANGENT_TRANSPOSED, ADJOINTS = "transpose of the ground's tangent", "adjoints"
PASSING_ADJOINTS = "adjoints that links pass on"
"""What is prepared outside of the sweeps: constants from parameters; sines and cosines; what links read of the ground, which
accelerates by -g or, for the mass matrix, not at all; memory of directions, which is zero before sweeps run backwards."""


@dataclass(frozen=True, slots=True)
class Array:
    """Numbers that a step knows by name.

    Attributes
    ----------
    name : str
    shape : tuple of str
        Axes, as letters or numbers, for people; none of a number.
    size : int
        Number of entries.
    lanes : bool
        There is one of each entry per direction.
    """

    name: str
    shape: tuple[str, ...]
    size: int
    lanes: bool = False

    def tangent(self, name: str = "") -> Array:
        """Its seed or its derivative."""
        return replace(self, name=name or f"d{self.name}", lanes=True)

    def called(self, name: str) -> Array:
        """Another array of the same shape."""
        return replace(self, name=name)


@dataclass(frozen=True, slots=True)
class Run:
    """Run a sweep."""

    sweep: str
    lanes: bool = False


@dataclass(frozen=True, slots=True)
class Formulas:
    """Evaluate the model's own formulas of some targets, or their tangents, or the transpose of these."""

    name: str
    targets: tuple[str, ...]
    lanes: bool = False
    backwards: bool = False

    def tangents(self) -> Formulas:
        return replace(self, lanes=True)

    def transpose(self) -> Formulas:
        return replace(self, lanes=True, backwards=True)

    @property
    def called(self) -> str:
        """Name of the function."""
        return f"{self.name}{'_transposed' if self.backwards else '_tangents' if self.lanes else ''}"


@dataclass(frozen=True, slots=True)
class Prepare:
    """Compute what lies outside of the sweeps, by name: constants, sines and cosines, what is known of the ground."""

    what: str
    lanes: bool = False


@dataclass(frozen=True, slots=True)
class Own:
    """From here on an array lies in memory of the call."""

    array: Array


@dataclass(frozen=True, slots=True)
class Bind:
    """From here on an array is the memory of another one, or of an argument, a seed or a result."""

    array: Array
    to: Array


@dataclass(frozen=True, slots=True)
class Hold:
    """From here on an array is a copy in memory of the call, which may be changed; what was given is called `given`."""

    array: Array
    given: Array


@dataclass(frozen=True, slots=True)
class Zero:
    """Set all entries to zero."""

    array: Array


@dataclass(frozen=True, slots=True)
class Copy:
    """Copy all entries; of result and array, the first has no memory but the caller's."""

    to: Array
    of: Array


@dataclass(frozen=True, slots=True)
class CopyEntry:
    """Copy one entry."""

    to: Array
    index: int
    of: Array
    entry: int


@dataclass(frozen=True, slots=True)
class AddEntry:
    """Add one entry to another."""

    to: Array
    index: int
    of: Array
    entry: int


@dataclass(frozen=True, slots=True)
class ZeroEntries:
    """Set some entries to zero."""

    array: Array
    entries: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Combine:
    """A sum of arrays, less others."""

    to: Array
    plus: tuple[Array, ...]
    minus: tuple[Array, ...] = ()


@dataclass(frozen=True, slots=True)
class Check:
    """Stop here if a pivot was zero."""

    lanes: bool = False


@dataclass(frozen=True, slots=True)
class Tolerate:
    """Nothing is solved for: zero pivots are no errors."""


@dataclass(frozen=True, slots=True)
class Routine:
    """Steps that procedures share: a function of its own, over directions or not."""

    name: str
    doc: str
    steps: tuple[Step, ...]

    @property
    def lanes(self) -> bool:
        return any(over_directions(s) for s in self.steps)


@dataclass(frozen=True, slots=True)
class Perform:
    """Do what a routine does."""

    routine: Routine


@dataclass(frozen=True, slots=True)
class Single:
    """Sweeps over directions that serve for values: one direction, before those of the seeds.

    Attributes
    ----------
    reads, writes : tuple of (Array, Array)
        Arrays of the sweeps, with the arguments and results that they are.
    """

    steps: tuple[Run, ...]
    reads: tuple[tuple[Array, Array], ...]
    writes: tuple[tuple[Array, Array], ...]


@dataclass(frozen=True, slots=True)
class Take:
    """Columns of a matrix from an array; a symmetric one is known from its lower half."""

    into: Array
    of: Array
    symmetric: bool = False


@dataclass(frozen=True, slots=True)
class Columns:
    """For each entry of an array, or some: steps with a one there and zeros elsewhere. They give one column of matrices.

    Where the array has directions, as many columns are computed at a time as there are directions.

    Attributes
    ----------
    unit : Array
        Zero before and after.
    steps : tuple of Step
    takes : tuple of Take
    among : tuple of int, optional
        The entries; columns of the others are zero.
    """

    unit: Array
    steps: tuple[Step, ...]
    takes: tuple[Take, ...]
    among: tuple[int, ...] | None = None


@dataclass(frozen=True, slots=True)
class AllColumns:
    """Columns of matrices, all of them at once or as many as there is room for; a link works on those that concern it.

    Attributes
    ----------
    units : tuple of (Array, int)
        By column: the array and its entry that are one. A link's columns stand together, in the order of the links.
    starts : tuple of int
        By link, its first column; last, how many there are.
    parents : tuple of int
        By link, the one that carries it, or -1.
    steps : tuple of Run
    of : Array
        What the steps give per column.
    into : tuple of (Array, int)
        By column: the matrix, and which of its columns it is.
    weighted : tuple of Weighted
        For each entry of `of`, columns of matrices that get its column, times a weight.
    width : int
        For how many columns there is room.
    symmetric : bool
        Columns of one symmetric matrix, of which each link works on those of later ones.
    groups : str
        Which columns a link works on in the last sweep; see `mechanics.sweeps.Sweep.groups`.
    by_turns : tuple of str
        Sweeps whose functions are called by turns with those of others.
    """

    units: tuple[tuple[Array, int], ...]
    starts: tuple[int, ...]
    parents: tuple[int, ...]
    steps: tuple[Run, ...]
    of: Array
    width: int
    into: tuple[tuple[Array, int], ...] = ()
    weighted: tuple[Weighted, ...] = ()
    symmetric: bool = False
    groups: str = ""
    by_turns: tuple[str, ...] = ()

    @property
    def seeds(self) -> tuple[Array, ...]:
        """The arrays that have ones."""
        return tuple(dict.fromkeys(a for a, _ in self.units))

    @property
    def arrays(self) -> tuple[Array, ...]:
        """The arrays that it needs, per column."""
        return (*self.seeds, self.of)

    @property
    def matrices(self) -> tuple[Array, ...]:
        """The matrices that it fills or adds to."""
        return tuple(dict.fromkeys(a for a, _ in (*self.into, *((w.into, w.column) for w in self.weighted))))


@dataclass(frozen=True, slots=True)
class Weighted:
    """A column of a matrix gets one of a symmetric matrix times the derivative of a formula by one of its arguments.

    Attributes
    ----------
    entry : int
        Number of the formula, and of the column.
    into : Array
    column : int
    seed : Array
        Along which the argument's derivative is taken; its entry is the column.
    direction : int
        Which of the directions has a one there: formulas that share no argument have the same ones.
    """

    entry: int
    into: Array
    column: int
    seed: Array
    direction: int


@dataclass(frozen=True, slots=True)
class Primitives:
    """Derivatives of formulas by single arguments, for the weights of `AllColumns`: several formulas in one direction."""

    formulas: Formulas
    of: Array
    weighted: tuple[Weighted, ...]


@dataclass(frozen=True, slots=True)
class Together:
    """Steps of targets that compute columns all at once, and `otherwise` those of targets that take one after the other."""

    steps: tuple[Step, ...]
    otherwise: tuple[Step, ...]


@dataclass(frozen=True, slots=True)
class IfAsked:
    """Steps for some results only, that are not taken where none of these is asked for."""

    results: tuple[Array, ...]
    steps: tuple[Step, ...]


Step = (
    Run
    | Formulas
    | Prepare
    | Own
    | Bind
    | Hold
    | Zero
    | Copy
    | CopyEntry
    | AddEntry
    | ZeroEntries
    | Combine
    | Check
    | Tolerate
    | Perform
    | Single
    | Columns
    | AllColumns
    | Primitives
    | Together
    | IfAsked
)


@dataclass(frozen=True, slots=True)
class Procedure:
    """A function of a solver.

    Attributes
    ----------
    name, doc : str
    arguments, seeds, results : tuple of Array
    steps : tuple of Step
    widths : tuple of int
        How many directions one call takes, of functions over directions; none for the others.
    member : str
        What a solver calls it, where that is another name.
    basic : bool
        States cannot be made consistent without it: a solver of chosen functions has it too.
    apart : tuple of int
        Further widths, for integration over time, compiled when they are first used.
    modes : Array or None
        It is there a second time, with this as a further argument: the modes of the model's switches.
    internal : bool
        Integrators call it, and nobody else.
    """

    name: str
    doc: str
    arguments: tuple[Array, ...]
    results: tuple[Array, ...]
    steps: tuple[Step, ...]
    seeds: tuple[Array, ...] = ()
    widths: tuple[int, ...] = ()
    member: str = ""
    basic: bool = False
    apart: tuple[int, ...] = ()
    modes: Array | None = None
    internal: bool = False

    @property
    def called(self) -> str:
        """What users call it."""
        return self.member or self.name

    def written_apart(self) -> frozenset[str]:
        """Results that no sweep writes: steps of the procedure copy into them, or another array is their memory."""
        found: set[str] = set()
        for step in within(self.steps):
            if isinstance(step, Copy):
                found.add(step.to.name)
            elif isinstance(step, Columns):
                found.update(t.into.name for t in step.takes)
            elif isinstance(step, AllColumns):
                found.update(m.name for m in step.matrices)
            elif isinstance(step, Single):
                found.update(to.name for _, to in step.writes)
            elif isinstance(step, Bind):
                found.add(step.to.name)
        return frozenset(r.name for r in self.results if r.name in found)

    def held(self) -> dict[str, Array]:
        """What arrays are called while they are as given, of those that routines copy."""
        return {s.array.name: s.given for s in walk(self.steps) if isinstance(s, Hold)}


def over_directions(step: Step) -> bool:
    """Whether a step works on directions."""
    match step:
        case Run() | Formulas() | Prepare() | Check():
            return step.lanes
        case Own() | Bind() | Hold() | Zero() | ZeroEntries():
            return step.array.lanes
        case Copy() | CopyEntry() | AddEntry() | Combine():
            return step.to.lanes
        case Perform():
            return step.routine.lanes
        case Columns():
            return step.unit.lanes or any(map(over_directions, step.steps))
        case IfAsked() | Together():
            return any(map(over_directions, step.steps))
        case Primitives():
            return True
        case Single() | Tolerate() | AllColumns():
            return False


def stops(step: Step) -> bool:
    """Whether what is done may end here, because of a pivot."""
    return isinstance(step, Check) or (isinstance(step, Perform) and any(map(stops, step.routine.steps)))


def walk(steps: tuple[Step, ...]) -> Iterator[Step]:
    """All steps in their order, those of routines and inner ones too, after what they are in."""
    for step in steps:
        yield step
        if isinstance(step, Perform):
            yield from walk(step.routine.steps)
        elif isinstance(step, (Single, Columns, AllColumns, IfAsked)):
            yield from walk(step.steps)
        elif isinstance(step, Together):
            yield from walk((*step.steps, *step.otherwise))
        elif isinstance(step, Primitives):
            yield step.formulas


def within(steps: tuple[Step, ...]) -> Iterator[Step]:
    """Steps, and those that are taken if something is asked for, in their order."""
    for step in steps:
        if isinstance(step, IfAsked):
            yield from within(step.steps)
        elif isinstance(step, Together):
            yield from within((*step.steps, *step.otherwise))
        else:
            yield step


def sweeps(procedures: tuple[Procedure, ...]) -> set[str]:
    """Sweeps that procedures run."""
    return {s.sweep for p in procedures for s in walk(p.steps) if isinstance(s, Run)}


def for_target(procedure: Procedure, together: bool) -> Procedure:
    """A procedure as a target has it that computes all columns of matrices together, or one after the other.

    What takes one after the other computes all results, whether asked for or not.
    """

    def chosen(steps: tuple[Step, ...]) -> tuple[Step, ...]:
        found: list[Step] = []
        for step in steps:
            if isinstance(step, Together):
                found += chosen(step.steps if together else step.otherwise)
            elif isinstance(step, IfAsked):
                inner = chosen(step.steps)
                found += [replace(step, steps=inner)] if together else inner
            else:
                found.append(step)
        return tuple(found)

    return replace(procedure, steps=chosen(procedure.steps))


def routines(procedures: tuple[Procedure, ...]) -> list[Routine]:
    """Every routine that procedures perform, after those that it performs itself."""
    found: dict[Routine, None] = {}

    def add(steps: tuple[Step, ...]) -> None:
        for step in walk(steps):
            if isinstance(step, Perform) and step.routine not in found:
                add(step.routine.steps)
                found[step.routine] = None

    for p in procedures:
        add(p.steps)
    return list(found)


def pruned(procedure: Procedure, lives: Callable[[Run | Formulas | Prepare], bool]) -> Procedure:
    """A procedure without the steps that have nothing to do, and without routines of such steps only."""

    def kept(steps: tuple[Step, ...]) -> tuple[Step, ...]:
        found: list[Step] = []
        for step in steps:
            if isinstance(step, (Run, Formulas, Prepare)):
                if lives(step):
                    found.append(step)
            elif isinstance(step, Perform):
                inner = kept(step.routine.steps)
                if inner:
                    found.append(Perform(replace(step.routine, steps=inner)))
            elif isinstance(step, (Columns, IfAsked)):
                found.append(replace(step, steps=kept(step.steps)))
            elif isinstance(step, (AllColumns, Single)):
                found.append(replace(step, steps=tuple(s for s in step.steps if lives(s))))
            else:
                found.append(step)
        return tuple(found)

    return replace(procedure, steps=kept(procedure.steps))


def flat(steps: tuple[Step, ...], which: Callable[[Step], bool] = over_directions) -> tuple[Step, ...]:
    """Steps with those of routines over directions, or of `which`, in the place of routines."""
    found: list[Step] = []
    for step in steps:
        found += flat(step.routine.steps, which) if isinstance(step, Perform) and which(step) else (step,)
    return tuple(found)


def counted(procedure: Procedure, outside: str) -> list[str]:
    """What a procedure runs, in the order in which it begins: sweeps, formulas by name, and `outside` for what it prepares.

    What it runs twice stands there twice. Each column of a matrix is a direction, so what computes columns counts once for all
    matrices. A sweep that runs for values, over one direction, is called ``solve_in_1``. Values and tangents of formulas, as well
    as what is prepared, have one name.
    """
    steps = tuple(within(procedure.steps))
    found = _names(steps, outside)
    shared = {outside, *(s.name for s in walk(procedure.steps) if isinstance(s, Formulas))}
    of_columns: list[str] = []
    for step in steps:
        if isinstance(step, (Columns, AllColumns)):
            names = _names(step.steps, outside)
            for name in dict.fromkeys(names):
                known = of_columns.count(name) + (found.count(name) if name in shared else 0)
                of_columns += [name] * (names.count(name) - known)
    return found + of_columns


def _names(steps: tuple[Step, ...], outside: str) -> list[str]:
    """What steps run once each, columns apart."""
    found: list[str] = []
    shared: dict[tuple[str, bool], int] = {}
    for step in flat(steps, lambda step: True):
        match step:
            case Run():
                found.append(step.sweep)
            case Formulas():
                times = shared[step.name, step.lanes] = shared.get((step.name, step.lanes), 0) + 1
                if times > found.count(step.name):
                    found.append(step.name)
            case Prepare(lanes=False) if outside not in found:  # nothing is computed for directions
                found.append(outside)
            case Single():
                found += [f"{s.sweep}_1" for s in step.steps]
            case Primitives() if step.formulas.name not in found:
                found.append(step.formulas.name)
            case _:
                pass
    return found
