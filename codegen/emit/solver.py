"""From a model to the files of its solver: analyse, expand, simplify, lay out, print. The stages, one below the other."""

from __future__ import annotations

import time
from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Any

from ..loops.description import describe
from ..loops.errors import AssemblyError, PartitionError
from ..loops.partition import Partition, partition
from ..mechanics.ears.orthogonal import RankLossError
from ..mechanics.elimination import ZeroPivotError
from ..mechanics.expansion import Place as MemoryPlace
from ..mechanics.expansion import Program, expand
from ..mechanics.formulas import FormulaKind, coefficient_formulas, force_formulas, initial_formulas
from ..mechanics.outputs.outputs import RecordFormula, output_formulas, potential_formula
from ..mechanics.procedures import (
    arrays,
    checked_backwards,
    left_out,
    procedures,
    sweeps,
    swept_backwards,
    swept_together,
)
from ..mechanics.stores import LAID_OUT, SLOT
from ..mechanics.structure.kinds import RegionKind
from ..mechanics.structure.system import System, analyse
from ..mechanics.sweeps import transpose_name, values_name
from ..mechanics.transposition import transpose_sweeps
from ..model.collector import collector_paused
from ..model.errors import ModelError
from ..model.model import GROUND, Model
from ..program.digits import long_numbers
from ..program.operations import Operations
from ..program.procedure import Formulas, Procedure, walk
from ..program.progress import Progress, silent
from .c import CWriter, write_c
from .calls import write_calls
from .interface import manifest, operations
from .motion import has_motion, write_four, write_motion, write_precise
from .numpy import write_numpy

UNROLLED_LINKS = 8
"""Models of at most so many links get one function per link unless another layout is asked for."""


@dataclass(slots=True)
class Source:
    """The files of a solver.

    Attributes
    ----------
    files : dict of str to str
    manifest : dict
        See `codegen.emit.interface.manifest`.
    seconds : dict of str to float
        By stage.
    passes : list of (str, Operations, float)
        After every pass: operations of all blocks, and seconds.
    choice : list of str
        What was chosen for closed loops, in words.
    chosen : Partition or None
        The same as data.
    """

    files: dict[str, str]
    manifest: dict[str, Any]
    system: System
    program: Program
    layout: str
    seconds: dict[str, float] = field(default_factory=dict)
    passes: list[tuple[str, Operations, float]] = field(default_factory=list)
    choice: list[str] = field(default_factory=list)
    chosen: Partition | None = None


@dataclass(slots=True)
class Expanded:
    """A model as statements, ready to be printed.

    Attributes
    ----------
    asked : tuple of Procedure
        The functions that the solver has.
    """

    system: System
    program: Program
    formulas: list[FormulaKind]
    records: list[RecordFormula]
    asked: tuple[Procedure, ...]


@collector_paused()
def write_solver(
    model: Model,
    layout: str = "auto",
    chosen: Partition | None = None,
    reactions: bool = False,
    progress: Progress = silent,
    functions: Collection[str] | None = None,
) -> Source:
    """Expand a model and print its solver.

    Parameters
    ----------
    model : Model
    layout : {"auto", "kinds", "unrolled"}
        One C function per kind of link, or one per link.
    chosen : Partition, optional
        Of the model's speeds, where it has loops; found if left out.
    reactions : bool
        The solver has a function for the wrenches that joints and loops transmit.
    progress : callable
        Hears what is being done; see `codegen.generation.generate`.
    functions : collection of str, optional
        Those that the solver has, all if left out; see `codegen.mechanics.procedures.procedures`.
    """
    seconds: dict[str, float] = {}
    clock = time.perf_counter()

    def lap(stage: str) -> None:
        nonlocal clock
        now = time.perf_counter()
        seconds[stage] = now - clock
        clock = now

    if not model.nu:
        raise ModelError([model.problem("bodies", "no joint has a freedom, so nothing can move")])
    unrolled = is_unrolled(model, layout)
    if model.loops and chosen is None:
        progress("choosing dependent coordinates", 0, 0)
        try:
            chosen = partition(model)
        except (AssemblyError, PartitionError) as error:
            raise ModelError([model.problem("loops", str(error))]) from None
        lap("partition")
    progress("analysing", 0, 0)
    system = analyse(model, unrolled, chosen)
    lap("analyse")
    e = _expanded(system, reactions, progress, functions)
    program, formulas, records, asked = e.program, e.formulas, e.records, e.asked
    lap("expand and simplify")
    progress("printing C", 0, 0)
    writer = CWriter(program, formulas, records, asked)
    context = writer.context()
    files = write_c(context)
    lap("print")
    progress("printing NumPy", 0, 0)
    files[f"{model.name}_numpy.py"] = write_numpy(program, formulas, records, asked)
    lap("print NumPy")
    counts = operations(program, [*formulas, *records], writer.procedures)
    made = manifest(system, writer.procedures, writer.workspace, counts, chosen.q if chosen else ())
    if functions is not None:
        made["left_out"] = left_out(system, asked)
    files[f"{model.name}_calls.c"] = write_calls(made, {n: a.size for n, a in arrays(system).items()})
    if has_motion(made["functions"]):
        files[f"{model.name}_motion.c"] = write_motion(system, made)
        if "state_rate_sensitivities" in made["functions"]:
            files[f"{model.name}_four.c"] = write_four(made)
        if model.loops:
            files[f"{model.name}_precise.c"] = write_precise(system, made)
    return Source(
        files,
        made,
        system,
        program,
        "unrolled" if unrolled else "kinds",
        seconds,
        program.report,
        describe(model, chosen) if chosen else [],
        chosen,
    )


def is_unrolled(model: Model, layout: str) -> bool:
    """Whether a layout has one function per link."""
    return layout == "unrolled" or (layout == "auto" and len(model.bodies) <= UNROLLED_LINKS)


def _expanded(
    system: System, reactions: bool, progress: Progress = silent, functions: Collection[str] | None = None
) -> Expanded:
    """Expand and simplify; see `write_solver`."""
    model = system.model
    asked = procedures(system, reactions, functions)
    read = {t for p in asked for s in walk(p.steps) if isinstance(s, Formulas) for t in s.targets}
    values, records = output_formulas(system)
    potential = potential_formula(system)
    if potential is not None:
        records.append(potential)
    records = [r for r in records if r.target in read]
    try:
        wanted, backwards = sweeps(asked), swept_backwards(asked)
        program = expand(
            system, wanted.union(backwards), _read_by_formulas(system, records), progress, functions is None
        )
    except RankLossError as error:
        raise ModelError([model.problem("loops", str(error))]) from None
    except ZeroPivotError as error:
        if isinstance(error.kind, RegionKind):
            what = system.regions.regions[error.kind.members[0]]
            names = ", ".join(dict.fromkeys(system.links[i].name for i, _ in what.freedoms))
            message = f"nothing that moves with {names} has inertia; give the bodies of the loops mass"
            raise ModelError([model.problem("loops", message)]) from None
        body = system.links[error.kind.members[0]].name.partition(".")[0]
        message = f"nothing outboard of the joint of {body!r} has inertia about it in any state; give it mass or fix the joint"
        raise ModelError([model.problem(f"bodies.{body}.joint", message)]) from None
    formulas = [*force_formulas(system), *coefficient_formulas(system), *values, *initial_formulas(model)]
    formulas = [f for f in formulas if f.target in read]
    tangents = [*(f.tangent for f in formulas), *(r.tangent for r in records)]
    # pivots are met whether the function that says so is among those asked for or not
    checked = checked_backwards(asked if functions is None else procedures(system, reactions))
    transpose_sweeps(program, backwards, tangents, checked, *swept_together(asked))
    for sweep in backwards:  # what was only there to be run backwards, or together with others
        for name in {sweep, values_name(sweep), transpose_name(sweep)} - wanted:
            program.blocks.pop(name, None)
    return Expanded(system, program, formulas, records, asked)


@collector_paused()
def write_long(
    model: Model,
    digits: int,
    layout: str,
    chosen: Partition | None = None,
    reactions: bool = False,
    functions: Collection[str] | None = None,
) -> str:
    """The NumPy module of a solver with numbers of so many digits, where they are no doubles; see `write_solver`."""
    with long_numbers(digits):
        e = _expanded(analyse(model, is_unrolled(model, layout), chosen), reactions, functions=functions)
        return write_numpy(e.program, e.formulas, e.records, e.asked)


def _read_by_formulas(system: System, records: list[RecordFormula]) -> set[MemoryPlace]:
    """Components of records and lanes that outputs and the potential energy read."""
    read: set[MemoryPlace] = set()
    for r in records:
        for _, links, _, _ in r.rows:
            kinds = [-1 if link == GROUND else system.kind_of[link].index for link in links]
            for block in (r.value, r.tangent):
                for store, name in block.loads.values():
                    if store.memory in LAID_OUT:
                        sweep = "moment_tangents" if store.memory is SLOT else ""
                        kind = kinds[store.place or 0]
                        read.add(((store.memory, sweep), kind, name))
    return read
