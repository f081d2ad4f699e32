"""What a target's language is to the writer: how a block, a loop, a table and a place in memory are written."""

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
    """Where a component lies, as a target writes it.

    Attributes
    ----------
    variable : str
        Name of a variable for the row; empty where none is needed.
    row : str
        What the variable is.
    text : str
        What follows the variable.
    type : str
        What the row consists of, where the language has types.
    names : tuple of str
        What a model calls it, if it is one thing in the model: the names that a variable may have, best first.
    """

    variable: str
    row: str
    text: str
    type: str = ""
    names: tuple[str, ...] = ()


Place = Callable[[Store, str], Located]
Column = Callable[[int], str]
"""The expression of an integer column of the current row of a table."""
RowPlace = Callable[[Column, Store, str], Located]
"""Where a component lies, for the current row of a table."""


class Language(ABC):
    """Source of a program in one language.

    Parameters
    ----------
    model : Model
        For names.
    plan : Plan
    asked : tuple of Procedure
        The functions of the solver.
    target : Target
    scalar : Scalar
    reserved : frozenset of str
        What variables cannot be called.
    """

    numbered = True
    """Places in memory are numbers, not names."""

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
        """By the numbers of a table: the function that it is called after."""

    # -- the language ----------------------------------------------------------------------------------------------

    @abstractmethod
    def lines(
        self, block: Block, place: Place, culprit: Callable[[str], str] | None = None, each: str = ""
    ) -> list[str]:
        """Lines of a block; `culprit` gives the number of the link or loop to name where a pivot is zero.

        `each` begins the loop over directions, where the language has one.
        """

    def each(self, kinds: Sequence[Kind], sweep: str) -> str:
        """What begins the loop over directions in the function that kinds share."""
        return ""

    @abstractmethod
    def signature(self, name: str, lanes: bool, indexed: bool) -> str:
        """Head of a function; an indexed one gets the number of a link or row."""

    @abstractmethod
    def call(self, name: str, lanes: bool, index: str | None) -> str:
        """Statement that calls a function."""

    @abstractmethod
    def repeat(self, start: int, end: int, step: int, inward: bool, calls: list[str]) -> list[str]:
        """Loop of i over ``start, start + step, ... < end``, or the same backwards."""

    @abstractmethod
    def dispatch(self, count: int, inward: bool, entry: str, calls: list[tuple[list[int], str]]) -> list[str]:
        """Loop over all links or units that chooses the call by the kind, which `entry` gives for each i."""

    def unused_index(self) -> list[str]:
        """Lines of a function that does not read the index that it gets."""
        return []

    @abstractmethod
    def repeat_rows(self, name: str, lanes: bool, count: int) -> list[str]:
        """Calls for all rows of a table."""

    @abstractmethod
    def add_table(self, name: str, rows: list[list[int]] | list[list[float]]) -> None:
        """Table of equally long rows; asked for twice, it stands there once."""

    @abstractmethod
    def place(self, kinds: Sequence[Kind], sweep: str, store: Store, name: str) -> Located:
        """Where a component of a store lies, in the function that kinds share."""

    @abstractmethod
    def element(self, array: str, index: str, lanes: bool = False) -> Located:
        """Where an entry of an argument, a seed or a result lies."""

    @abstractmethod
    def field_of_record(self, store: Store, link: str, name: str) -> Located:
        """Where a component of the record, the lanes or the ground's slot of a link lies."""

    @abstractmethod
    def constant(self, shape: int, constants: str, name: str) -> Located:
        """Where a constant of the constants at a place lies."""

    @abstractmethod
    def place_of_constants(self, index: int) -> int:
        """Where constants begin."""

    @abstractmethod
    def prepared(self, what: str) -> list[str]:
        """Lines, in a routine, for what lies outside of the sweeps; see `Prepare`."""

    @abstractmethod
    def number_of_row(self, table: str, row: str, index: int) -> Located:
        """Where a number of the current row lies."""

    def lines_of(
        self,
        block: Block,
        place: Place,
        culprit: Callable[[str], str] | None = None,
        each: str = "",
        about: str = "",
    ) -> list[str]:
        """Those of `lines`; `about` is what they compute, for messages.

        Raises
        ------
        UnwritableError
            The target cannot write them.
        """
        try:
            return self.lines(block, place, culprit, each)
        except TargetError as error:
            raise UnwritableError(self.target.name, about or block.title, error) from None

    # -- names -----------------------------------------------------------------------------------------------------

    def names_of(self, array: str, index: str) -> tuple[str, ...]:
        """What the model calls an entry of an argument, a seed or a result: ``length``, ``q_crank``, ``dp_length``."""
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
        """What a function calls what a block loads, where the model has a name for it."""
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
