"""A model as statements: analysed, expanded and simplified, with the selected functions of its solver."""

from __future__ import annotations

from collections.abc import Collection

from ..loops.partition import Partition
from ..model.errors import ModelError
from ..model.model import GROUND, Model
from ..program.counting import sweeps
from ..program.formula import Formula
from ..program.plan import Plan
from ..program.procedure import Formulas, Procedure, walk
from ..program.progress import Progress, silent
from .constants_twice import differentiate_twice
from .ears.orthogonal import RankLossError
from .elimination import ZeroPivotError
from .expansion import Program, expand
from .formulas import coefficient_formulas, force_formulas, initial_formulas, motion_formulas
from .formulas_twice import differentiate_records
from .outputs.frames import SIZES, frame_formulas, place_formulas
from .outputs.outputs import output_formulas, potential_formula
from .outputs.switches import switch_formulas
from .patterns import GROUND_KIND
from .patterns import Place as MemoryPlace
from .plan import plan_of
from .procedures import (
    GRADIENT_TANGENTS,
    SECOND_ORDER,
    SWITCH_PRODUCTS,
    SWITCHES,
    check_names,
    checked_backwards,
    procedures,
    swept_backwards,
    swept_together,
)
from .stores import ADJOINT, ADJOINT_LANE, LAID_OUT, SLOT
from .structure.kinds import RegionKind
from .structure.system import System, analyse
from .sweeps import transpose_name, values_name
from .transposition import transpose_sweeps

UNROLLED_LINKS = 8
"""Models with at most this many links get one function per link by default."""

DIFFERENT_LINKS, DIFFERENT = 12, 0.75
"""Larger models, with at most this many links, also get one function per link if at least this fraction of the links
are of different kinds: the code is then hardly longer."""


def laid_out(model: Model, layout: str, chosen: Partition | None, turning: bool) -> tuple[System, bool]:
    """The system of a model, and whether it gets one function per link: by `layout`, or by the numbers of links and kinds.

    `turning` allows the ground to be rotated; see `mechanics.structure.system.analyse`.
    """
    if layout == "unrolled":
        return analyse(model, True, chosen, turning=turning), True
    system = analyse(model, False, chosen, turning=turning)
    links, kinds = len(system.links), len(system.kinds)
    few = min(links, len(model.bodies)) <= UNROLLED_LINKS or (links <= DIFFERENT_LINKS and kinds >= DIFFERENT * links)
    if layout == "auto" and few:
        return analyse(model, True, chosen, turning=turning), True
    return system, False


def expanded(
    system: System,
    reactions: bool,
    progress: Progress = silent,
    functions: Collection[str] | None = None,
    frames: bool = False,
    moves: bool = True,
) -> tuple[Program, Plan, tuple[Procedure, ...]]:
    """Expands and simplifies a system; returns its statements, the plan for targets and the functions of the solver."""
    model = system.model
    selected = procedures(system, reactions, functions, frames, moves)
    read = {t for p in selected for s in walk(p.steps) if isinstance(s, Formulas) for t in s.targets}
    second = [p for p in selected if p.name in (*SECOND_ORDER, SWITCH_PRODUCTS)]
    for shape in system.shapes if second else ():
        differentiate_twice(shape)
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
    _differentiate_twice(second, [*values, *records], bool(model.loops))
    check_names(selected)
    try:
        wanted, backwards = sweeps(selected), swept_backwards(selected)
        read_by, given = _read_by_formulas(system, records), _given_by_formulas(system, records)
        all_sweeps, whole = wanted.union(backwards), functions is None
        gradients = any(p.name == GRADIENT_TANGENTS for p in selected)
        program = expand(system, all_sweeps, read_by, progress, whole, given, len(second) == 1, gradients)
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
    _drop_unknown(records, program)
    formulas = [*force_formulas(system), *coefficient_formulas(system), *motion_formulas(model), *values]
    formulas += [*initial_formulas(model), *place_formulas(model)]
    formulas = [*(f for f in formulas if f.target in read), *records]
    tangents = [f.tangent for f in formulas]
    # pivots are checked whether or not the function that reports them is selected
    checked = checked_backwards(selected if functions is None else procedures(system, reactions, moves=moves))
    transpose_sweeps(program, backwards, tangents, checked, *swept_together(selected))
    for sweep in backwards:  # sweeps that are needed for their transposes only, or that were merged
        for name in {sweep, values_name(sweep), transpose_name(sweep)} - wanted:
            program.blocks.pop(name, None)
    return program, plan_of(program, formulas), selected


def _differentiate_twice(second: list[Procedure], formulas: list[Formula], loops: bool) -> None:
    """Prepares the formulas that functions with second derivatives evaluate."""
    curved = {t for p in second for s in walk(p.steps) if isinstance(s, Formulas) and s.twice for t in s.targets}
    for formula in formulas:
        formula.in_loops = loops
        if formula.target in curved and formula.differentiable is not None:
            differentiate_records(formula)


def _kinds_of(system: System, links: tuple[int, ...]) -> list[int]:
    return [GROUND_KIND if link == GROUND else system.kind_of[link].index for link in links]


def _given_by_formulas(system: System, records: list[Formula]) -> set[MemoryPlace]:
    """Adjoints of records to which formulas contribute."""
    found: set[MemoryPlace] = set()
    for r in records:
        for _, links, _, _ in r.rows if r.of_records else ():
            kinds = _kinds_of(system, links)
            stores = [(a, n) for a, n, _ in r.adjoint.stores if a.memory is ADJOINT]
            found |= {((a.memory, ""), kinds[a.place or 0], n) for a, n in stores}
    return found


def _drop_unknown(formulas: list[Formula], program: Program) -> None:
    """Drops contributions of formulas to adjoints that no sweep reads."""
    for f in formulas:
        for block in f.of_records or ():
            block.stores = [
                (a, n, e)
                for a, n, e in block.stores
                if a.memory not in (ADJOINT, ADJOINT_LANE) or n in program.fields[a.memory]
            ]


def _read_by_formulas(system: System, records: list[Formula]) -> set[MemoryPlace]:
    """Components of records and lanes that outputs and the potential energy read."""
    read: set[MemoryPlace] = set()
    for r in records:
        for _, links, _, _ in r.rows:
            kinds = _kinds_of(system, links)
            for block in (r.value, r.tangent, *(r.of_records or ())):
                for store, name in block.loads.values():
                    if store.memory in LAID_OUT:
                        sweep = "moment_tangents" if store.memory is SLOT else ""
                        kind = kinds[store.place or 0]
                        read.add(((store.memory, sweep), kind, name))
    return read
