"""From a model to the files of its solver: analyse, expand, simplify, lay out, print. The stages, one below the other."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

from ..loops.description import describe
from ..loops.errors import AssemblyError, PartitionError
from ..loops.partition import Partition, partition
from ..mechanics.ears.orthogonal import RankLossError
from ..mechanics.elimination import ZeroPivotError
from ..mechanics.expansion import Place as MemoryPlace
from ..mechanics.expansion import Program, expand
from ..mechanics.formulas import FormulaKind, coefficient_formulas, force_formulas, initial_formulas, motion_formulas
from ..mechanics.outputs.frames import SIZES, frame_formulas, place_formulas
from ..mechanics.outputs.outputs import RecordFormula, output_formulas, potential_formula
from ..mechanics.outputs.switches import switch_formulas
from ..mechanics.procedures import (
    SWITCHES,
    arrays,
    asks_reactions,
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
from ..program.algebra import expressions_kept
from ..program.digits import long_numbers
from ..program.operations import Operations
from ..program.procedure import Formulas, Procedure, for_target, walk
from ..program.progress import Progress, silent
from .c import CWriter, write_c
from .calls import write_calls
from .interface import manifest, operations
from .motion import has_motion, write_four, write_motion, write_precise
from .numpy import write_numpy
from .states import arrays_of, over_states, write_states, write_threads

UNROLLED_LINKS = 8
"""Models of at most so many links get one function per link unless another layout is asked for."""

DIFFERENT_LINKS, DIFFERENT = 12, 0.75
"""The same for models of at most so many links of which such a part are of kinds of their own: to write each out takes little
more code."""


Printed = Callable[[Mapping[str, str], Mapping[str, Any]], None]


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


@expressions_kept()
@collector_paused()
def write_solver(
    model: Model,
    layout: str = "auto",
    chosen: Partition | None = None,
    reactions: bool = False,
    progress: Progress = silent,
    functions: Collection[str] | None = None,
    frames: bool = False,
    printed: Printed | None = None,
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
    frames : bool
        The solver has functions for the frames of all bodies.
    printed : callable, optional
        Called with the files and the manifest when all of the C is printed, before the rest is.
    """
    seconds: dict[str, float] = {}
    clock = time.perf_counter()

    def lap(stage: str) -> None:
        nonlocal clock
        now = time.perf_counter()
        seconds[stage] = now - clock
        clock = now

    if not model.nu and not model.prescribed:
        raise ModelError([model.problem("bodies", "no joint has a freedom, so nothing can move")])
    if model.loops and chosen is None:
        progress("choosing dependent coordinates", 0, 0)
        try:
            chosen = partition(model)
        except (AssemblyError, PartitionError) as error:
            raise ModelError([model.problem("loops", str(error))]) from None
        lap("partition")
    if chosen is not None:
        model = model.with_turned(chosen.turned)
    progress("analysing", 0, 0)
    system, unrolled = laid_out(model, layout, chosen, turning=not (reactions or asks_reactions(functions)))
    lap("analyse")
    e = _expanded(system, reactions, progress, functions, frames)
    program, formulas, records, asked = e.program, e.formulas, e.records, e.asked
    lap("expand and simplify")
    progress("printing C", 0, 0)
    writer = CWriter(program, formulas, records, tuple(for_target(p, True) for p in asked))
    context = writer.context()
    files = write_c(context)
    counts = operations(program, [*formulas, *records], writer.procedures)
    made = manifest(system, writer.procedures, writer.workspace, counts, chosen.q if chosen else ())
    if functions is not None:
        made["left_out"] = left_out(system, asked)
    if over := over_states(writer.procedures):
        made["over_states"] = {
            "functions": [p.name for p in over],
            "arrays": [name for names in arrays_of(over) for name in names],
            "workspace": context["states_workspace"],
            "swept": writer.memory_of_sweeps,
        }
    files[f"{model.name}_calls.c"] = write_calls(made, {n: a.size for n, a in arrays(system).items()})
    if has_motion(made["functions"]):
        files[f"{model.name}_motion.c"] = write_motion(system, made, writer.procedures)
    lap("print")
    if printed is not None:
        printed(files, made)
        lap("begin to compile")
    files |= write_apart(context, system, made, writer.procedures)
    lap("print what is compiled apart")
    progress("printing NumPy", 0, 0)
    files[f"{model.name}_numpy.py"] = write_numpy(program, formulas, records, one_by_one(asked))
    lap("print NumPy")
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


def write_apart(
    context: dict[str, Any], system: System, made: Mapping[str, Any], procedures: tuple[Procedure, ...]
) -> dict[str, str]:
    """C files that are compiled apart, when they are needed."""
    name, files = system.model.name, {}
    if context["functions_over_states"]:
        files[f"{name}_states.c"] = write_states(context)
        files[f"{name}_threads.c"] = write_threads(context, made["over_states"]["arrays"])
    if has_motion(made["functions"]):
        if "state_rate_sensitivities" in made["functions"]:
            files[f"{name}_four.c"] = write_four(made, procedures)
        if system.model.loops:
            files[f"{name}_precise.c"] = write_precise(system, made, procedures)
    return files


def laid_out(model: Model, layout: str, chosen: Partition | None, turning: bool) -> tuple[System, bool]:
    """A model analysed, and whether it has one function per link: chosen by links and kinds unless the layout says so.

    Of `turning`, the ground may be turned; see `mechanics.structure.system.analyse`.
    """
    if layout == "unrolled":
        return analyse(model, True, chosen, turning=turning), True
    system = analyse(model, False, chosen, turning=turning)
    links, kinds = len(system.links), len(system.kinds)
    few = min(links, len(model.bodies)) <= UNROLLED_LINKS or (links <= DIFFERENT_LINKS and kinds >= DIFFERENT * links)
    if layout == "auto" and few:
        return analyse(model, True, chosen, turning=turning), True
    return system, False


def _expanded(
    system: System,
    reactions: bool,
    progress: Progress = silent,
    functions: Collection[str] | None = None,
    frames: bool = False,
) -> Expanded:
    """Expand and simplify; see `write_solver`."""
    model = system.model
    asked = procedures(system, reactions, functions, frames)
    read = {t for p in asked for s in walk(p.steps) if isinstance(s, Formulas) for t in s.targets}
    values, records = output_formulas(system)
    if SWITCHES.targets[0] in read:
        of_state, of_points = switch_formulas(system)
        values += of_state
        records += of_points
    potential = potential_formula(system)
    if potential is not None:
        records.append(potential)
    records = [r for r in records if r.target in read]
    for target in SIZES:
        records += frame_formulas(system, target) if target in read else []
    try:
        wanted, backwards = sweeps(asked), swept_backwards(asked)
        program = expand(
            system, wanted.union(backwards), _read_by_formulas(system, records), progress, functions is None
        )
    except RankLossError as error:
        raise ModelError([model.problem("loops", str(error))]) from None
    except OverflowError as error:
        message = f"numbers of the model overflow when they are multiplied ({error}); check lengths, masses and units"
        raise ModelError([model.problem("bodies", message)]) from None
    except ZeroPivotError as error:
        if isinstance(error.kind, RegionKind):
            what = system.regions.regions[error.kind.members[0]]
            names = ", ".join(dict.fromkeys(system.links[i].name for i, _ in what.freedoms))
            message = f"nothing that moves with {names} has inertia; give the bodies of the loops mass"
            raise ModelError([model.problem("loops", message)]) from None
        body = system.links[error.kind.members[0]].name.partition(".")[0]
        message = f"nothing outboard of the joint of {body!r} has inertia about it in any state; give it mass or fix the joint"
        raise ModelError([model.problem(f"bodies.{body}.joint", message)]) from None
    formulas = [*force_formulas(system), *coefficient_formulas(system), *motion_formulas(model), *values]
    formulas += [*initial_formulas(model), *place_formulas(model)]
    formulas = [f for f in formulas if f.target in read]
    tangents = [*(f.tangent for f in formulas), *(r.tangent for r in records)]
    # pivots are met whether the function that says so is among those asked for or not
    checked = checked_backwards(asked if functions is None else procedures(system, reactions))
    transpose_sweeps(program, backwards, tangents, checked, *swept_together(asked))
    for sweep in backwards:  # what was only there to be run backwards, or together with others
        for name in {sweep, values_name(sweep), transpose_name(sweep)} - wanted:
            program.blocks.pop(name, None)
    return Expanded(system, program, formulas, records, asked)


@expressions_kept()
@collector_paused()
def write_long(
    model: Model,
    digits: int,
    layout: str,
    chosen: Partition | None = None,
    reactions: bool = False,
    functions: Collection[str] | None = None,
    frames: bool = False,
) -> str:
    """The NumPy module of a solver with numbers of so many digits, where they are no doubles; see `write_solver`."""
    with long_numbers(digits):
        system, _ = laid_out(model, layout, chosen, turning=not (reactions or asks_reactions(functions)))
        e = _expanded(system, reactions, functions=functions, frames=frames)
        return write_numpy(e.program, e.formulas, e.records, one_by_one(e.asked))


def one_by_one(asked: tuple[Procedure, ...]) -> tuple[Procedure, ...]:
    """Functions as NumPy has them: columns of matrices one after the other."""
    return tuple(for_target(p, False) for p in asked if not p.internal)


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
