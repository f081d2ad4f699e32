"""Generates the files of a solver from a model in stages: analyse, expand, simplify, lay out, print."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

from .emit.c import C
from .emit.c.calls import write_calls
from .emit.c.functions import batch_arrays
from .emit.c.module import CWriter, write_c
from .emit.c.motion import has_motion, write_four, write_motion, write_precise
from .emit.c.states import over_states, write_states, write_threads
from .emit.numpy.module import write_numpy
from .emit.registry import BESIDE_C, RESERVED
from .emit.target import Scalar, TargetError, UnwritableError
from .loops.description import describe
from .loops.errors import AssemblyError, PartitionError
from .loops.partition import Partition, partition
from .loops.redundancy import ALLOWED
from .manifest import manifest, operations
from .mechanics.expansion import Program
from .mechanics.merging import with_merged_sweeps
from .mechanics.procedures import (
    asks_reactions,
    left_out,
)
from .mechanics.statements import expanded, laid_out
from .mechanics.structure.system import System
from .model.collector import collector_paused
from .model.errors import ModelError
from .model.model import Model
from .program.algebra import expressions_kept
from .program.chosen_steps import for_target
from .program.digits import long_numbers
from .program.limits import limited
from .program.operations import Operations
from .program.plan import Plan
from .program.procedure import Procedure
from .program.progress import Progress, silent

Printed = Callable[[Mapping[str, str], Mapping[str, Any]], None]


@dataclass(slots=True)
class Source:
    """The files of a solver, with data about their generation.

    Attributes
    ----------
    files : dict of str to str
    manifest : dict
        See `codegen.manifest.manifest`.
    seconds : dict of str to float
        Time of each stage, s.
    passes : list of (str, Operations, float)
        Operations of all blocks after each pass, and the time of the pass.
    choice : list of str
        Description of the choice of dependent coordinates in closed loops.
    chosen : Partition or None
        The choice itself.
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
    scalar: str = "float64",
) -> Source:
    """Expands a model and prints its solver.

    Parameters
    ----------
    model : Model
    layout : {"auto", "kinds", "unrolled"}
        One C function per kind of link, or one per link.
    chosen : Partition, optional
        Partition of the model's speeds, if it has loops; chosen automatically if left out.
    reactions : bool
        Whether to include functions for the wrenches that joints and loops transmit.
    progress : callable
        Receives progress reports; see `codegen.generation.generate`.
    functions : collection of str, optional
        Functions of the solver, all if left out; see `codegen.mechanics.procedures.procedures`.
    frames : bool
        Whether to include functions for the frames of all bodies.
    printed : callable, optional
        Called with the files and the manifest as soon as the C code that is compiled first is printed.
    scalar : str
        The scalar type of the C; see `codegen.emit.target.Scalar`.

    Raises
    ------
    ModelError
        If the model has no solver, or a target cannot write it.
    TargetError
        If the scalar type does not exist.
    """
    of = C.scalar(scalar)
    with limited(of.limits):
        try:
            _look_at_defaults(model, of)
            return _written(model, layout, chosen, reactions, progress, functions, frames, printed, of)
        except UnwritableError as error:
            raise ModelError([model.problem(error.place, f"{model.name}, {error}")]) from None


@expressions_kept()
@collector_paused()
def look_ahead(model: Model, chosen: Partition | None) -> None:
    """Raises `ModelError` if a model has no solver: expands it as `write_solver` does, for accelerations only."""
    _look_at_freedoms(model)
    if chosen is not None:
        model = model.with_turned(chosen.turned)
    expanded(laid_out(model, "auto", chosen, turning=True)[0], False, functions=("accelerations",))


def _look_at_freedoms(model: Model) -> None:
    """Raises `ModelError` if nothing can move."""
    if not model.nu and not model.prescribed:
        raise ModelError([model.problem("bodies", "no joint has a degree of freedom, so nothing can move")])


def _look_at_defaults(model: Model, scalar: Scalar) -> None:
    """Raises `UnwritableError` if the scalar type cannot hold the default of a parameter."""
    for parameter in model.parameters:
        try:
            scalar.literal(repr(float(parameter.value)))
        except TargetError as error:
            raise UnwritableError(C.name, f"parameters.{parameter.name}", error) from None


def _written(
    model: Model,
    layout: str,
    chosen: Partition | None,
    reactions: bool,
    progress: Progress,
    functions: Collection[str] | None,
    frames: bool,
    printed: Printed | None,
    scalar: Scalar,
) -> Source:
    """Runs the stages in order; see `write_solver`."""
    seconds: dict[str, float] = {}
    clock = time.perf_counter()

    def lap(stage: str) -> None:
        nonlocal clock
        now = time.perf_counter()
        seconds[stage] = now - clock
        clock = now

    _look_at_freedoms(model)
    if model.loops and chosen is None:
        chosen = _dependents(model, progress)
        lap("partition")
    if chosen is not None:
        model = model.with_turned(chosen.turned)
    progress("analysing", 0, 0)
    system, unrolled = laid_out(model, layout, chosen, turning=not (reactions or asks_reactions(functions)))
    lap("analyse")
    program, plan, asked = expanded(system, reactions, progress, functions, frames, scalar.moves)
    lap("expand and simplify")
    progress("printing C", 0, 0)
    lacks = {} if functions is None else {"left_out": left_out(system, asked)}
    of_c = with_merged_sweeps(program, plan.formulas) if unrolled else plan
    writer, context, files, made = _in_c(system, program, of_c, asked, chosen, scalar, lacks)
    lap("print")
    if printed is not None:
        printed(files, made)
        lap("begin to compile")
    files |= write_apart(context, system.model, made, writer.procedures)
    lap("print what is compiled apart")
    progress("printing NumPy", 0, 0)
    for ending, write in BESIDE_C.items():
        files[f"{model.name}{ending}"] = write(system.model, plan, one_by_one(asked), RESERVED)
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


def _dependents(model: Model, progress: Progress) -> Partition:
    """The choice of dependent coordinates for a model with loops."""
    progress("choosing dependent coordinates", 0, 0)
    try:
        return partition(model)
    except (AssemblyError, PartitionError) as error:
        raise ModelError([model.problem("loops", str(error))]) from None


def _in_c(
    system: System,
    program: Program,
    plan: Plan,
    asked: tuple[Procedure, ...],
    chosen: Partition | None,
    scalar: Scalar,
    lacks: dict[str, list[str]],
) -> tuple[CWriter, dict[str, Any], dict[str, str], dict[str, Any]]:
    """The C code that is compiled first: its writer, the variables of the templates, the files, and the manifest.

    `lacks`: entries of the manifest about functions that were not selected.
    """
    model, procedures = system.model, tuple(for_target(p, True) for p in asked)
    writer = CWriter(model, plan, procedures, scalar, RESERVED)
    context = writer.context()
    files = write_c(context)
    counts = operations(program, plan, writer.procedures)
    guess = chosen.q if chosen else ()
    made = manifest(system, writer.procedures, writer.workspace, counts, guess, writer.has_parts, scalar.name) | lacks
    if over := over_states(writer.procedures):
        made["over_states"] = {
            "functions": [p.name for p in over],
            "arrays": [name for names in batch_arrays(over) for name in names],
            "workspace": context["states_workspace"],
            "swept": writer.memory_of_sweeps,
        }
    files[f"{model.name}_calls.c"] = write_calls(made, {n: a.size for n, a in plan.arguments.items()})
    if has_motion(made["functions"]):
        allowed = ALLOWED * made.get("loop_tolerance", 0.0)
        files[f"{model.name}_motion.c"] = write_motion(model, made, writer.procedures, allowed)
    return writer, context, files, made


def write_apart(
    context: dict[str, Any], model: Model, made: Mapping[str, Any], procedures: tuple[Procedure, ...]
) -> dict[str, str]:
    """C files of separate libraries, which are compiled when needed."""
    name, files = model.name, {}
    if context["functions_over_states"]:
        files[f"{name}_states.c"] = write_states(context)
        files[f"{name}_threads.c"] = write_threads(context, made["over_states"]["arrays"])
    if has_motion(made["functions"]):
        if "state_rate_sensitivities" in made["functions"]:
            files[f"{name}_four.c"] = write_four(made, procedures)
        if model.loops:
            files[f"{name}_precise.c"] = write_precise(model, made, procedures, context["called"])
    return files


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
    """The NumPy module of a solver with constants of more digits than doubles have; see `write_solver`."""
    with long_numbers(digits):
        system, _ = laid_out(model, layout, chosen, turning=not (reactions or asks_reactions(functions)))
        _, plan, asked = expanded(system, reactions, functions=functions, frames=frames)
        return write_numpy(system.model, plan, one_by_one(asked), RESERVED)


def one_by_one(asked: tuple[Procedure, ...]) -> tuple[Procedure, ...]:
    """Functions for NumPy, which computes columns of matrices one after another."""
    return tuple(for_target(p, False) for p in asked if not p.internal)
