"""The statements of a model's solver as equations of sympy: every sweep, body by body, with equation numbers."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import sympy

from ..elementary import BY_SYMBOL
from ..html_tables import html_of
from ..loops.errors import AssemblyError, PartitionError
from ..loops.partition import partition
from ..mechanics.plan import unit_name
from ..mechanics.procedures import UnknownFunctionError
from ..mechanics.statements import expanded, laid_out
from ..mechanics.structure.system import System
from ..model.errors import ModelError
from ..model.model import Model
from ..program.algebra import Expr, Function, Number, expressions_kept
from ..program.block import Block
from ..program.field_table import field_of, identifier
from ..program.formula import Formula
from ..program.plan import Plan
from ..program.procedure import Formulas, walk
from ..program.shape import Constants
from ..program.store import SHAPE, Store
from .errors import SymbolicError
from .kept import ARGUMENTS, Kept, Namer, Names, of_constants
from .polynomials import exact

PRIMITIVE = "primitive"
"""The tag of statements that are derivative primitives."""

IN_TITLE = re.compile(r"\((Eqs?\. [^)]*)\)")

EQUATIONS = {
    "pose": "Eq. 22", "turns": "Eq. 22", "residuals": "Eq. 5", "seed_residuals": "Eq. 7", "correct": "Eq. 30",
    "velocity": "Eq. 18", "kinetic": "Eq. 18", "link_acceleration": "Eq. 21", "clear": "Eq. 24", "load": "Eq. 24",
    "element_energy": "potential energy", "column_clear": "Eq. 45", "column_rest": "Eq. 53", "column_begin": "Eq. 54",
    "column_seed": "Eq. 21", "rate": "Eq. 1", "masses": "first moment", "mass": "first moment", "moments": "first moment",
    "moment": "first moment", "mass_in": "Eq. 45", "force": "Eq. 45", "gradient_out": "Eq. 54", "gradient_in": "Eq. 45",
    "formula": "formula",
}  # fmt: skip
"""By the beginning of a sweep's name: the tag of statements that have none, if the title of the sweep names no
equation."""


def tag_of_sweep(sweep: str, title: str, each_direction: bool) -> str:
    """The tag of a statement without a tag of its own."""
    if found := IN_TITLE.search(title):
        return found[1]
    base, transposed, _ = sweep.partition("_transposed")
    base = base.removesuffix("_values").removesuffix("_tangents")
    derivative = ("T d " if transposed else "d ") if each_direction else ""
    return derivative + EQUATIONS.get(base, title)


@dataclass(frozen=True)
class Assignment:
    """One statement of a solver.

    Attributes
    ----------
    number : int
        Counted from 1 through the whole recursion.
    target : sympy.Symbol
        A local variable, or ``STORE.COMPONENT`` of a stored quantity: ``me`` is the unit itself, ``up`` its parent. Arguments and
        results have the names of the model where the statement is of one unit alone: ``udot.crank``.
    value : sympy.Expr
    tag : str
        The statement's equation in the paper, such as ``Eq. 45``; ``d Eq. 45`` is its derivative, ``T d Eq. 45`` the
        transpose of this derivative; or words that docs/theory.md explains.
    is_primitive : bool
        Whether the statement is the derivative of another statement with respect to one of its operands (Eq. 10).
    each_direction : bool
        Whether the statement is computed for each direction of derivatives.
    adds : bool
        Whether the value is added to the present value of the target.
    """

    number: int
    target: sympy.Symbol
    value: sympy.Expr
    tag: str
    is_primitive: bool = False
    each_direction: bool = False
    adds: bool = False

    @property
    def equation(self) -> sympy.Eq:
        """Target and value as an equation of sympy, unevaluated."""
        return sympy.Eq(self.target, self.target + self.value if self.adds else self.value, evaluate=False)


@dataclass(frozen=True)
class Unit:
    """The statements of a sweep for links, ears, regions or force elements of one kind.

    Attributes
    ----------
    what : str
        ``links``, ``ears``, ``regions``, or a type of force elements.
    members : tuple of str
        Names of the links, ears, regions or force elements that have these statements.
    kept : dict of sympy.Symbol to Kept
        Quantities that symbols in memory denote; arguments and results are not among them.
    assignments : tuple of Assignment
    """

    what: str
    members: tuple[str, ...]
    kept: dict[sympy.Symbol, Kept]
    assignments: tuple[Assignment, ...]


@dataclass(frozen=True)
class SweepOfUnits:
    """One pass over all units of a model.

    Attributes
    ----------
    name, title : str
    direction : {"outward", "inward", ""}
        From the ground to the tips or back; empty where no unit depends on another.
    units : tuple of Unit
        In the order in which they are computed.
    """

    name: str
    title: str
    direction: str
    units: tuple[Unit, ...]


@dataclass(frozen=True)
class Recursion:
    """All statements of a solver. Made by `statements`.

    Attributes
    ----------
    name : str
        Name of the model.
    sweeps : tuple of SweepOfUnits
        Constants of links first, then the sweeps in the order of the paper, formulas of the model last.
    """

    name: str
    sweeps: tuple[SweepOfUnits, ...]

    def __repr__(self) -> str:
        return f"<Recursion of {self.name}: {self.count} statements in {len(self.sweeps)} sweeps>"

    def _repr_html_(self) -> str:
        rows = ((s.name, sum(len(unit.assignments) for unit in s.units)) for s in self.sweeps)
        return html_of([repr(self)], ("sweep", "statements"), rows)

    def __iter__(self) -> Iterator[Assignment]:
        for sweep in self.sweeps:
            for unit in sweep.units:
                yield from unit.assignments

    @cached_property
    def count(self) -> int:
        """The number of statements."""
        return sum(1 for _ in self)

    @cached_property
    def fields(self) -> dict[str, tuple[str, str, str, str]]:
        """The stored quantities: by short name, the name in generated code, unit, axes and meaning."""
        found = {}
        components = {of.component for sweep in self.sweeps for unit in sweep.units for of in unit.kept.values()}
        for component in sorted(components):
            field = field_of(component)
            if field is not None:
                called = re.sub(r"_[xyz]{1,2}$", "", identifier(component.partition("/")[0]))
                found[field.name] = called, field.unit, field.frame, field.meaning
        return found


def statements(
    model: Model, *, functions: Collection[str] | None = None, reactions: bool = False, frames: bool = False
) -> Recursion:
    """Return every statement of a model's solver, as equations of sympy.

    Zero terms are absent, and common subexpressions appear once: these are the statements that the C and the NumPy of a
    solver print.

    Parameters
    ----------
    model : Model
        The model.
    functions : collection of str, optional
        Functions of the solver, such as ``["accelerations", "sensitivities"]``. Default: all.
    reactions, frames : bool, optional
        Include the functions for reactions and frames, as in `codegen.generate`.

    Returns
    -------
    Recursion
        The statements by sweep.

    Raises
    ------
    ModelError
        If the model has no degree of freedom.
    SymbolicError
        If a function is unknown.

    Examples
    --------
    >>> import ordernm
    >>> from ordernm.symbolic import statements
    >>> found = statements(ordernm.load_model("examples/pendulum.yaml"), functions=["accelerations"])
    >>> [sweep.name for sweep in found.sweeps]
    ['constants', 'kinematics', 'triangularize', 'back_substitute']
    >>> inward = found.sweeps[2]
    >>> [(x.target, x.value, x.tag) for x in inward.units[0].assignments if x.tag != "zero pivot"][:2]
    [(Dinv, 1/c.J.xx, 'Eq. 47'), (rD, -Dinv*me.n.z, 'Eq. 53')]
    """
    if not model.nu and not model.prescribed:
        raise ModelError([model.problem("bodies", "no joint has a degree of freedom, so nothing can move")])
    with expressions_kept():
        return _Reader(*_planned(model, functions, reactions, frames)).recursion()


def _planned(
    model: Model, functions: Collection[str] | None, reactions: bool, frames: bool
) -> tuple[System, Plan, set[str]]:
    """The analysed model, the plan of its solver, and the targets of formulas whose transposes are run."""
    chosen = None
    if model.loops:
        try:
            chosen = partition(model)
        except (AssemblyError, PartitionError) as error:
            raise ModelError([model.problem("loops", str(error))]) from None
        model = model.with_turned(chosen.turned)
    try:
        system, _ = laid_out(model, "auto", chosen, turning=not reactions)
        _, plan, asked = expanded(system, reactions, functions=functions, frames=frames)
    except UnknownFunctionError as error:
        raise SymbolicError(str(error)) from None
    return system, plan, {
        t for p in asked for s in walk(p.steps) if isinstance(s, Formulas) and s.backwards for t in s.targets
    }  # fmt: skip


class _Reader:
    """Converts and numbers the statements of a plan, and the transposes of the formulas whose targets are in
    `backwards`."""

    def __init__(self, system: System, plan: Plan, backwards: set[str]) -> None:
        self.system, self.plan, self.backwards = system, plan, backwards
        self.names = Names(system, plan)
        self.number = 0

    def recursion(self) -> Recursion:
        """All statements of the plan."""
        plan, name = self.plan, self.system.model.name
        users: dict[int, list[tuple[str, Constants]]] = {shape.index: [] for shape in plan.shapes}
        for owner, of_owner in plan.owners:
            users[of_owner.shape.index].append((owner, of_owner))
        constants = [
            self.unit(
                "constants", [owner for owner, _ in users[shape.index]], [shape.block],
                partial(of_constants, [c for _, c in users[shape.index]]),
                partial(_only, [owner for owner, _ in users[shape.index]]),
            ) for shape in plan.shapes if shape.block.stores
        ]  # fmt: skip
        found = [
            SweepOfUnits(
                "constants",
                "constants of links, and their derivatives with respect to parameters (Eq. 29)",
                "",
                tuple(constants),
            )
        ]
        for sweep, of in plan.sweeps.items():
            order = dict.fromkeys(reversed(of.order) if of.inward else of.order)
            units = tuple(
                self.unit(
                    plan.called[kind][0], [unit_name(self.system, kind, m) for m in kind.members], [of.blocks[kind.index]],
                    partial(self.names.of_kind, kind, sweep), partial(self.names.owner, kind, sweep), sweep,
                )
                for kind in order if kind.index in of.blocks and _says_something(of.blocks[kind.index])
            )  # fmt: skip
            found.append(SweepOfUnits(sweep, of.title, "inward" if of.inward else "outward", units))
        formulas = [
            self.unit(
                "formulas",
                f.places,
                self.blocks_of(f),
                partial(self.names.of_formula, f),
                lambda store: store.owner.name,
            )
            for f in plan.formulas
        ]
        found.append(SweepOfUnits("formulas", "formulas of the model, and their derivatives", "", tuple(formulas)))
        return Recursion(name, tuple(sweep for sweep in found if sweep.units))

    def blocks_of(self, formula: Formula) -> list[Block]:
        """A formula, its tangent, and the transpose of the tangent where functions run it backwards."""
        return [formula.value, formula.tangent, *([formula.transposed] if formula.target in self.backwards else [])]

    def unit(
        self,
        what: str,
        members: Sequence[str],
        blocks: Sequence[Block],
        name: Namer,
        owner: Callable[[Store], str],
        sweep: str = "",
    ) -> Unit:
        """The statements of a block, or of several blocks of one formula.

        `name` returns the symbol of a stored component, and `owner` the owner of the memory.
        """
        memory: dict[sympy.Symbol, Kept] = {}
        found: list[Assignment] = []
        for block in blocks:
            of_sweep = partial(tag_of_sweep, sweep or _part_of_formula(block), block.title)
            known = {symbol.name: name(*of) for symbol, of in block.loads.items()}
            convert = _Converter(known)
            for store, component in [*block.loads.values(), *((a, c) for a, c, _ in block.stores)]:
                symbol = name(store, component)
                label = "c" if store is SHAPE else store.plain.label
                if symbol.is_Symbol and symbol.name.startswith(f"{label}.") and store.name not in ARGUMENTS:
                    memory[symbol] = Kept(owner(store.plain), symbol.name.partition(".")[2], store.lanes)
            tags = {}
            for s in block.statements:
                tag = s.tag or of_sweep(s.lanes)
                tags[s.target.name] = tag
                found.append(self.assignment(
                    convert(s.target), convert(s.expression), tag, is_primitive=s.tag.endswith(PRIMITIVE), each=s.lanes
                ))  # fmt: skip
            for store, component, value in block.stores:
                own = {tags[s.name] for s in value.free_symbols if s.name in tags}
                tag = own.pop() if len(own) == 1 else of_sweep(store.lanes)
                found.append(self.assignment(
                    name(store, component), convert(value), tag, each=store.lanes, adds=store.adds
                ))  # fmt: skip
        return Unit(what, tuple(members), memory, tuple(found))

    def assignment(
        self, target: sympy.Symbol, value: sympy.Expr, tag: str, *, is_primitive: bool = False, each: bool = False,
        adds: bool = False,
    ) -> Assignment:  # fmt: skip
        """Make the assignment with the next number."""
        self.number += 1
        return Assignment(self.number, target, value, tag, is_primitive, each, adds)


def _part_of_formula(block: Block) -> str:
    """The name of a block of formulas, used like the name of a sweep."""
    return "formula_transposed" if block.name.endswith("_transposed") else "formula"


def _only(names: Sequence[str], store: Store) -> str:
    """The name of the owner of constants that a block computes, if there is only one."""
    return names[0] if len(names) == 1 else ""


def _says_something(block: Block) -> bool:
    return bool(block.statements or block.stores)


class _Converter:
    """Converts expressions of statements to those of sympy.

    Parameters
    ----------
    known : dict of str to sympy.Symbol
        Symbols of the names that are read; all other names are local variables.
    """

    def __init__(self, known: dict[str, sympy.Symbol]) -> None:
        self.known = known

    def __call__(self, e: Expr) -> sympy.Expr:
        if e.is_Symbol:
            name = str(e)
            return self.known.get(name) or sympy.Symbol(name, real=True)
        if isinstance(e, Number):
            return exact(e.value) if isinstance(e.value, float) else sympy.Rational(str(e.value))
        arguments = [self(a) for a in e.args]
        if e.is_Add:
            return sympy.Add(*arguments)
        if e.is_Mul:
            return sympy.Mul(*arguments)
        if e.is_Pow:
            return sympy.Pow(*arguments)
        assert isinstance(e, Function)
        return FUNCTIONS[e.name](*arguments) if e.name in FUNCTIONS else sympy.Function(e.name)(*arguments)


FUNCTIONS: dict[str, Callable[..., sympy.Expr]] = {
    **{name: getattr(sympy, e.spelled("sympy")) for name, e in BY_SYMBOL.items() if name},
    "AtLeast": lambda a, b: sympy.Piecewise((1, sympy.Ge(a, b)), (0, True)),
    "Choice": lambda c, a, b: sympy.Piecewise((a, sympy.Ne(c, 0)), (b, True)),
    "Vanishing": lambda a, b: a * b, "Along": lambda a, b: a * b, "Power": sympy.Pow, "Floor": sympy.floor,
}  # fmt: skip
"""Functions of statements as functions of sympy. Functions that depend on a mode of an integrator have their own names."""

__all__ = ["Assignment", "Recursion", "SweepOfUnits", "Unit", "statements"]
