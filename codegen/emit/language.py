"""The interface between a writer and a target's language: blocks, loops, tables and places in memory."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence

from ..model.model import Model
from ..program.addresses import Kind
from ..program.block import RESERVED, Block
from ..program.plan import Plan
from ..program.procedure import Procedure
from ..program.store import Store
from ..records import dataclass
from .target import Scalar, Target, TargetError, UnwritableError


@dataclass(frozen=True, slots=True)
class Located:
    """Place of a component in the language of a target.

    Attributes
    ----------
    variable : str
        Name of a variable for the row of memory; empty if no variable is needed.
    row : str
        Expression of the row, the value of the variable.
    text : str
        Text that follows the name of the variable in the expression of the component, such as ``->omega_x``.
    type : str
        Type of the row, if the language has types.
    names : tuple of str
        Possible names of a variable for the component, best first, from the names in the model. Empty if the component
        belongs to several entries of the model.
    """

    variable: str
    row: str
    text: str
    type: str = ""
    names: tuple[str, ...] = ()


Place = Callable[[Store, str], Located]
Column = Callable[[int], str]
"""A function that returns the expression of an integer column in the current row of a table."""
RowPlace = Callable[[Column, Store, str], Located]
"""A function that returns the place of a component for the current row of a table."""


class Language(ABC):
    """Base class of the writers: prints a program in one language.

    Parameters
    ----------
    model : Model
        Model, for names.
    plan : Plan
    asked : tuple of Procedure
        The functions of the solver.
    target : Target
    scalar : Scalar
    reserved : frozenset of str
        Words that are not allowed as names of variables.
    """

    numbered = True
    """Whether places in memory are numbers; otherwise they are names."""

    def __init__(
        self,
        model: Model,
        plan: Plan,
        asked: tuple[Procedure, ...],
        target: Target,
        scalar: Scalar,
        reserved: frozenset[str],
    ):
        self.asked = asked
        self.target, self.scalar, self.reserved = target, scalar, reserved
        self.model, self.plan = model, plan
        self.layout = plan.layout
        self.addresses = plan.addresses(self.numbered)
        self.parameter_places = {name: i for i, name in enumerate(self.model.parameter_names)}
        self._names: dict[str, Sequence[str]] = {
            "nq": self.model.coordinate_names, "nu": self.model.speed_names, "np": self.model.parameter_names,
            "ninputs": self.model.inputs,
        }  # fmt: skip
        self.reads_numbers = False
        """Whether any function reads the table of numbers that differ within a kind."""
        self._shared: dict[str, list[tuple[Kind, ...]]] = {}
        self._tables_of_numbers: dict[str, str] = {}
        """The function after which a table of numbers is named, by the table's contents."""

    # -- the language ----------------------------------------------------------------------------------------------

    @abstractmethod
    def lines(
        self, block: Block, place: Place, culprit: Callable[[str], str] | None = None, each: str = ""
    ) -> list[str]:
        """Lines of a block. `culprit` returns the number of the link or loop to report if a pivot is zero.

        `each` begins the loop over directions, where the language has one.
        """

    def each(self, kinds: Sequence[Kind], sweep: str) -> str:
        """The beginning of the loop over directions in a function that several kinds share."""
        return ""

    @abstractmethod
    def signature(self, name: str, lanes: bool, indexed: bool) -> str:
        """The head of a function; an indexed function has the number of a link or row as an argument."""

    @abstractmethod
    def call(self, name: str, lanes: bool, index: str | None) -> str:
        """Statement that calls a generated function."""

    @abstractmethod
    def repeat(self, start: int, end: int, step: int, inward: bool, calls: list[str]) -> list[str]:
        """Loop over i from `start` by `step` to before `end`, or the same in reverse."""

    @abstractmethod
    def dispatch(self, count: int, inward: bool, entry: str, calls: list[tuple[list[int], str]]) -> list[str]:
        """Loop over all links or units that selects the call by kind; `entry` gives the kind for each i."""

    def unused_index(self) -> list[str]:
        """Lines that mark the index of a function as unused."""
        return []

    @abstractmethod
    def repeat_rows(self, name: str, lanes: bool, count: int) -> list[str]:
        """Calls of a function for all rows of a table."""

    @abstractmethod
    def add_table(self, name: str, rows: list[list[int]] | list[list[float]]) -> None:
        """Add a table with rows of equal length to the file."""

    @abstractmethod
    def place(self, kinds: Sequence[Kind], sweep: str, store: Store, name: str) -> Located:
        """Place of a component of a store, in a function that several kinds share."""

    @abstractmethod
    def element(self, array: str, index: str, lanes: bool = False) -> Located:
        """Place of an entry of an argument, a seed or a result."""

    @abstractmethod
    def field_of_record(self, store: Store, link: str, name: str) -> Located:
        """Place of a component in the record, the lanes or the ground's slot of a link."""

    @abstractmethod
    def constant(self, shape: int, constants: str, name: str) -> Located:
        """Place of a constant, counted from the first constant of the same owner."""

    @abstractmethod
    def place_of_constants(self, index: int) -> int:
        """Place of the first constant of an owner."""

    @abstractmethod
    def prepared(self, what: str) -> list[str]:
        """Lines of a preparation that runs outside of sweeps, in a routine; see `Prepare`."""

    @abstractmethod
    def number_of_row(self, table: str, row: str, index: int) -> Located:
        """Place of a number in the current row of a table of numbers."""

    def lines_of(
        self,
        block: Block,
        place: Place,
        culprit: Callable[[str], str] | None = None,
        each: str = "",
        about: str = "",
    ) -> list[str]:
        """Same as `lines`; `about` describes the block in messages.

        Raises
        ------
        UnwritableError
            If the target cannot write them.
        """
        try:
            return self.lines(block, place, culprit, each)
        except TargetError as error:
            raise UnwritableError(self.target.name, about or block.title, error) from None

    # -- names -----------------------------------------------------------------------------------------------------

    def names_of(self, array: str, index: str) -> tuple[str, ...]:
        """Name of an entry of an argument, a seed or a result in the model: ``length``, ``q_crank``, ``dp_length``."""
        known = self.plan.arguments
        of = known.get(array) or known.get(array.removeprefix("d"))
        axes = of.shape if of is not None else ()
        found = self._names.get(axes[0]) if len(axes) == 1 else None
        if found is None or not index.isdigit():
            return ()
        name = re.sub(r"\W", "_", found[int(index)])
        own = (name,) if array in ("p", "inputs") else ()
        return *own, f"{'input' if array == 'inputs' else array}_{name}"

    def called_by(self, block: Block, place: Place) -> dict[str, str]:
        """Names of variables for loaded values that have a name in the model."""
        taken = {s.name for s in block.loads} | {s.target.name for s in block.statements} | RESERVED | self.reserved
        found: dict[str, str] = {}
        for symbol, (store, component) in block.loads.items():
            name = next(
                (n for n in place(store, component).names if n not in taken and not n.isupper() and n[0] != "_"), None
            )
            if name is not None:
                found[symbol.name] = name
                taken.add(name)
        return found
