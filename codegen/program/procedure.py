"""Procedures: the steps of each function of a solver, as data.

A procedure takes *arguments* and *seeds* and gives *results*. Its steps run sweeps and formulas, which read and write arrays by
name. An array with the name of an argument, a seed or a result lies in the caller's memory unless a step puts it elsewhere. A
`Routine` holds steps that several procedures share. Every target prints its functions from these steps, and operations are
counted from them.

There are no branches: a procedure has no steps for features that its model lacks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from ..records import dataclass

WIDTHS = (8, 2, 1)
"""Numbers of directions for which the sensitivities are generated."""

CONSTANTS, ANGLES = "constants", "angles"
GROUND, GROUND_AT_REST = "ground", "ground at rest"
GROUND_TANGENT, GROUND_TANGENT_AT_REST = "tangent of the ground", "tangent of the ground at rest"
GROUND_TANGENT_TRANSPOSED, ADJOINTS = "transpose of the ground's tangent", "adjoints"
PASSING_ADJOINTS = "adjoints that links pass on"
ADJOINT_VALUES, ADJOINT_TANGENTS, GROUND_TWICE = "adjoints of values", "tangents of adjoints", "the ground's adjoint"
NO_TANGENTS, KEPT_ADJOINTS, RESTORED_ADJOINTS = "no tangents", "copy of the adjoints", "adjoints from their copy"
GROUND_GRADIENT = "the gradient with respect to gravity's parameters"
"""Names of preparations outside of the sweeps: compute constants from parameters; compute sines and cosines; set the state of the
ground, which accelerates by -g or, for the mass matrix, not at all; set memory of adjoints to zero before transposed sweeps."""


@dataclass(frozen=True, slots=True)
class Array:
    """Named numbers that steps read and write.

    Attributes
    ----------
    name : str
    shape : tuple of str
        Axes, as letters or numbers, for documentation; empty for a scalar.
    size : int
        Number of entries.
    lanes : bool
        Whether there is one value of each entry per direction.
    """

    name: str
    shape: tuple[str, ...]
    size: int
    lanes: bool = False

    def tangent(self, name: str = "") -> Array:
        """The array of seeds or derivatives of this array."""
        return replace(self, name=name or f"d{self.name}", lanes=True)

    def called(self, name: str) -> Array:
        """An array of the same shape with another name."""
        return replace(self, name=name)


@dataclass(frozen=True, slots=True)
class Run:
    """Run a sweep."""

    sweep: str
    lanes: bool = False


@dataclass(frozen=True, slots=True)
class Formulas:
    """Evaluate the model's own formulas for some results; or their tangents, transposed tangents, or with `twice` the tangents
    of the transposed tangents.

    `backwards` without `lanes`: the transposed tangents for one vector of weights, but only results that other steps read.
    """

    name: str
    targets: tuple[str, ...]
    lanes: bool = False
    backwards: bool = False
    twice: bool = False

    def tangents(self) -> Formulas:
        return replace(self, lanes=True)

    def transpose(self) -> Formulas:
        return replace(self, lanes=True, backwards=True)

    def adjoint(self) -> Formulas:
        return replace(self, backwards=True)

    @property
    def called(self) -> str:
        """Name of the function."""
        if not self.lanes:
            return f"{self.name}_adjoint" if self.backwards else self.name
        return f"{self.name}_{'twice' if self.twice else 'transposed' if self.backwards else 'tangents'}"


@dataclass(frozen=True, slots=True)
class Prepare:
    """Prepare something outside of the sweeps, by name: constants, sines and cosines, the state of the ground."""

    what: str
    lanes: bool = False


@dataclass(frozen=True, slots=True)
class Own:
    """From this step on, an array uses memory that exists during the call only."""

    array: Array


@dataclass(frozen=True, slots=True)
class Bind:
    """From this step on, an array uses the memory of another array, or of an argument, a seed or a result."""

    array: Array
    to: Array


@dataclass(frozen=True, slots=True)
class Hold:
    """From this step on, an array is a copy of the caller's array, whose entries may change. The caller's array gets the
    name `given`."""

    array: Array
    given: Array


@dataclass(frozen=True, slots=True)
class Zero:
    """Set all entries to zero."""

    array: Array


@dataclass(frozen=True, slots=True)
class Copy:
    """Copy all entries of an array to another. If one of the two is a result, it uses the caller's memory."""

    to: Array
    of: Array


@dataclass(frozen=True, slots=True)
class CopyEntry:
    """Copy one entry of an array."""

    to: Array
    index: int
    of: Array
    entry: int


@dataclass(frozen=True, slots=True)
class AddEntry:
    """Add one entry of an array to an entry of another."""

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
    """Set an array to a sum of arrays, minus other arrays."""

    to: Array
    plus: tuple[Array, ...]
    minus: tuple[Array, ...] = ()


@dataclass(frozen=True, slots=True)
class Check:
    """Return from the function at this step if a sweep has found a zero pivot."""

    lanes: bool = False


@dataclass(frozen=True, slots=True)
class Tolerate:
    """Ignore the zero pivots that the following sweeps find: the function solves no system."""


@dataclass(frozen=True, slots=True)
class Routine:
    """Steps that procedures share, as a function of its own, over directions or not."""

    name: str
    doc: str
    steps: tuple[Step, ...]

    @property
    def lanes(self) -> bool:
        return any(over_directions(s) for s in self.steps)


@dataclass(frozen=True, slots=True)
class Perform:
    """Run a routine."""

    routine: Routine


@dataclass(frozen=True, slots=True)
class Single:
    """Compute a value by sweeps over directions with one direction only; later steps run these sweeps over the seeds' directions.

    Attributes
    ----------
    reads, writes : tuple of (Array, Array)
        Pairs of an array of the sweeps and the argument or result that it stands for.
    """

    steps: tuple[Run | Formulas, ...]
    reads: tuple[tuple[Array, Array], ...]
    writes: tuple[tuple[Array, Array], ...]


@dataclass(frozen=True, slots=True)
class Take:
    """Take the columns of a matrix from an array; a symmetric matrix is given by its lower half."""

    into: Array
    of: Array
    symmetric: bool = False


@dataclass(frozen=True, slots=True)
class Columns:
    """Compute matrices column by column: for each entry of an array, run steps with this entry one and all others zero.

    If the array has directions, each run of the steps computes one column per direction.

    Attributes
    ----------
    unit : Array
        The array in which one entry is set to one; it is zero before and afterwards.
    steps : tuple of Step
    takes : tuple of Take
    among : tuple of int, optional
        Entries to use; the columns of the others are zero.
    """

    unit: Array
    steps: tuple[Step, ...]
    takes: tuple[Take, ...]
    among: tuple[int, ...] | None = None


@dataclass(frozen=True, slots=True)
class AllColumns:
    """Compute columns of matrices, at most `width` at a time. The function of a link processes the columns that it affects.

    Attributes
    ----------
    units : tuple of (Array, int)
        By column: the array and the entry that is one. Columns of one link are adjacent, in the order of the links.
    starts : tuple of int
        By link: its first column. The last entry is the number of columns.
    parents : tuple of int
        By link: its parent, or -1.
    steps : tuple of Run
    of : Array
        Array that the steps compute per column.
    into : tuple of (Array, int)
        By column: the matrix and the number of its column.
    weighted : tuple of Weighted
        For each entry of `of`: columns of matrices that receive its column times a weight.
    width : int
        Largest number of columns at a time.
    symmetric : bool
        Whether these are columns of one symmetric matrix, of which the function of a link needs those of later links only.
    groups : str
        Columns that the function of a link processes in the last sweep; see `mechanics.sweeps.Sweep.groups`.
    by_turns : tuple of str
        Sweeps whose function for a link is called right after that of another sweep (`Sweep.then`).
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
        """The arrays of seeds in which entries are set to one."""
        return tuple(dict.fromkeys(a for a, _ in self.units))

    @property
    def arrays(self) -> tuple[Array, ...]:
        """The arrays that have one value per column."""
        return (*self.seeds, self.of)

    @property
    def matrices(self) -> tuple[Array, ...]:
        """The matrices to which the steps write or add columns."""
        return tuple(dict.fromkeys(a for a, _ in (*self.into, *((w.into, w.column) for w in self.weighted))))


@dataclass(frozen=True, slots=True)
class Weighted:
    """Adds a column of a symmetric matrix, times the derivative of a formula with respect to one argument, to a column of
    another matrix.

    Attributes
    ----------
    entry : int
        Number of the formula, and of the column of the symmetric matrix.
    into : Array
    column : int
    seed : Array
        Seed of the argument; the number of the column is the number of the seed's entry.
    direction : int
        Direction in which this entry of the seed is one. Formulas without a common argument share directions.
    """

    entry: int
    into: Array
    column: int
    seed: Array
    direction: int


@dataclass(frozen=True, slots=True)
class Primitives:
    """Compute the derivatives of formulas with respect to single arguments, as weights of `AllColumns`; formulas share
    directions."""

    formulas: Formulas
    of: Array
    weighted: tuple[Weighted, ...]


@dataclass(frozen=True, slots=True)
class Together:
    """Steps for targets that compute all columns at once, and `otherwise` steps for targets that compute one column at a time."""

    steps: tuple[Step, ...]
    otherwise: tuple[Step, ...]


@dataclass(frozen=True, slots=True)
class IfAsked:
    """Steps for optional results, skipped if none of these is requested."""

    results: tuple[Array, ...]
    steps: tuple[Step, ...]


Step = (
    Run | Formulas | Prepare | Own | Bind | Hold | Zero | Copy | CopyEntry | AddEntry | ZeroEntries | Combine |
    Check | Tolerate | Perform | Single | Columns | AllColumns | Primitives | Together | IfAsked
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Procedure:
    """A function of a solver.

    Attributes
    ----------
    name, doc : str
    arguments, seeds, results : tuple of Array
    steps : tuple of Step
    widths : tuple of int
        Directions per call, for functions over directions; otherwise empty.
    member : str
        Name of the solver's method, if it differs.
    basic : bool
        Whether the function is needed to make states consistent. Then every solver has it, whichever functions are selected.
    apart : tuple of int
        Further numbers of directions, for integration over time; these variants are compiled on first use.
    modes : Array or None
        If given, a variant exists with this further argument, the modes of the model's switches.
    internal : bool
        Whether only integrators call it.
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
        """The name by which users call the function."""
        return self.member or self.name

    def written_apart(self) -> frozenset[str]:
        """Results that no sweep writes: steps copy values into these results, or another array uses their memory."""
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
        """The caller's arrays that steps `Hold` copy, by the names that these steps give them."""
        return {s.array.name: s.given for s in walk(self.steps) if isinstance(s, Hold)}


def over_directions(step: Step) -> bool:
    """Return whether a step works on directions."""
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
    """Return whether a step may end the call because of a zero pivot."""
    return isinstance(step, Check) or (isinstance(step, Perform) and any(map(stops, step.routine.steps)))


def walk(steps: tuple[Step, ...]) -> Iterator[Step]:
    """All steps in order; the steps inside a routine or another step follow the step that contains them."""
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
    """Steps in order, including optional ones."""
    for step in steps:
        if isinstance(step, IfAsked):
            yield from within(step.steps)
        elif isinstance(step, Together):
            yield from within((*step.steps, *step.otherwise))
        else:
            yield step


def flat(steps: tuple[Step, ...], which: Callable[[Step], bool] = over_directions) -> tuple[Step, ...]:
    """Steps in which each call of a routine over directions, or of a routine selected by `which`, is replaced by its steps."""
    found: list[Step] = []
    for step in steps:
        found += flat(step.routine.steps, which) if isinstance(step, Perform) and which(step) else (step,)
    return tuple(found)
