"""Functions as data: every step refers to something that exists; trees, loops and springs have their own steps."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from codegen.loops.partition import partition
from codegen.mechanics.procedures import OTHER_WIDTHS, check_names, procedures
from codegen.mechanics.quantities import POSE
from codegen.mechanics.structure.system import System, analyse
from codegen.mechanics.sweeps import SWEEP
from codegen.model import load_model, parse_model
from codegen.model.model import Model
from codegen.program.chosen_steps import routines
from codegen.program.counting import sweeps
from codegen.program.procedure import (
    WIDTHS,
    Array,
    Bind,
    Columns,
    Combine,
    Copy,
    CopyEntry,
    Formulas,
    Hold,
    Own,
    Perform,
    Procedure,
    Routine,
    Run,
    Single,
    Step,
    Zero,
    over_directions,
    walk,
    within,
)

EXAMPLES = Path(__file__).parents[2] / "examples"
SPRUNG = """
model: sprung
gravity: [0, 0, -9.81]
parameters: {k: 50.0}
bodies:
  a: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, inertia: {xx: 0.1, yy: 0.1, zz: 0.1}, com: [0, 0, -1]}
forces:
  spring: {type: spring, from: {body: a, at: [0, 0.1, -0.4]}, to: {body: ground, at: [1, 0, 0]}, stiffness: k}
outputs:
  energy: potential_energy
  height: {position: {body: a, at: [0, 0, -0.4]}, axis: z}
"""
NAMES = ("double_pendulum", "arm", "satellite", "four_bar", "stewart", "bricard", "sprung")
LOOP_SWEEPS = {"closures", "residuals", "correct", "condition_numbers", "complete", "seed_residuals"}
TREE_FUNCTIONS = {"mass_matrix", "inverse_mass_matrix", "solve_mass", "inverse_dynamics"}
TARGETS = {"tau", "coefficient", "outputs", "energy", "initial_q", "initial_u", "switches"}


@cache
def system(name: str) -> System:
    model: Model = parse_model(SPRUNG) if name == "sprung" else load_model(EXAMPLES / f"{name}.yaml")
    return analyse(model, False, partition(model) if model.loops else None)


@cache
def functions(name: str, reactions: bool = True) -> dict[str, Procedure]:
    return {p.name: p for p in procedures(system(name), reactions)}


def every(name: str) -> Iterator[tuple[Procedure, Step]]:
    for p in functions(name).values():
        for step in walk(p.steps):
            yield p, step


def own_steps(p: Procedure) -> list[Step]:
    return list(walk(p.steps))


@pytest.mark.parametrize("name", NAMES)
def test_every_step_names_what_exists(name: str) -> None:
    for p, step in every(name):
        if isinstance(step, Run):
            assert step.lanes == SWEEP[step.sweep].lanes, (p.name, step)
        elif isinstance(step, Formulas):
            assert set(step.targets) <= TARGETS
        elif isinstance(step, Single):
            assert all(SWEEP[s.sweep].lanes for s in step.steps)


@pytest.mark.parametrize("name", NAMES)
def test_routines_are_over_directions_or_not(name: str) -> None:
    """They get one of the two parts of a call; names are of one routine."""
    found = routines(tuple(functions(name).values()))
    for routine in found:
        assert {over_directions(s) for s in routine.steps} == {routine.lanes}, routine.name
        assert not any(isinstance(s, (Columns, Single)) for s in routine.steps), routine.name
    assert len({r.name for r in found}) == len(found)


@pytest.mark.parametrize("name", NAMES)
def test_arrays_that_are_read_were_given_or_written(name: str) -> None:
    """What a step copies or adds is an argument, a seed, a result, or an array that an earlier step has placed."""
    for p in functions(name).values():
        known: set[str] = {a.name for a in (*p.arguments, *p.seeds, *p.results)} | {"tau", "dtau"}
        known |= {a.name for a in p.held().values()} | p.held().keys()
        for step in walk(p.steps):
            read: tuple[Array, ...] = ()
            match step:
                case Own() | Hold():
                    known.add(step.array.name)
                case Bind():
                    read = (step.to,)
                    known.add(step.array.name)
                case Zero():
                    read = (step.array,)
                case Copy() | CopyEntry():
                    read = (step.of, step.to)
                case Combine():
                    read = (*step.plus, *step.minus, step.to)
                case Columns():
                    read = (step.unit, *(t.of for t in step.takes), *(t.into for t in step.takes))
                case Single():
                    read = tuple(of for _, of in (*step.reads, *step.writes))
                case _:
                    pass
            assert {a.name for a in read} <= known, (p.name, step)


@pytest.mark.parametrize("name", NAMES)
def test_seeds_and_derivatives_are_those_of_arguments_and_results(name: str) -> None:
    for p in functions(name).values():
        backwards = p.name.endswith("_transposed")
        of = functions(name)[p.name.removesuffix("_transposed")]
        given, found = (of.results, of.seeds) if backwards else (tuple(a.tangent() for a in p.arguments), ())
        assert set(p.seeds) <= set(given) and set(found) <= set(p.results)
        assert bool(p.seeds) == bool(p.widths) == any(r.lanes for r in p.results), p.name
        assert p.widths == (() if not p.seeds else WIDTHS if p.name == "sensitivities" else OTHER_WIDTHS)
        for step in walk(p.steps):
            if isinstance(step, Columns):
                assert all(t.into.size == step.unit.size * t.of.size for t in step.takes)
                assert step.among is None or set(step.among) <= set(range(step.unit.size))
            elif isinstance(step, (Bind, Copy)):
                pair = (step.array, step.to) if isinstance(step, Bind) else (step.to, step.of)
                assert pair[0].size == pair[1].size and pair[0].lanes == pair[1].lanes, (p.name, step)
    accelerations, sensitivities = functions(name)["accelerations"], functions(name)["sensitivities"]
    assert sensitivities.arguments == accelerations.arguments
    assert sensitivities.seeds == tuple(a.tangent() for a in accelerations.arguments)


@pytest.mark.parametrize("name", NAMES)
def test_loops_and_trees_have_their_own_steps(name: str) -> None:
    loops = bool(system(name).model.loops)
    run = sweeps(tuple(functions(name).values()))
    assert (run & LOOP_SWEEPS) == (LOOP_SWEEPS if loops else set())
    assert not any(isinstance(s, Hold) for _, s in every(name)) or loops
    assert (functions(name).keys() >= TREE_FUNCTIONS) != loops
    assert ("closure" in functions(name)) == loops


def test_what_is_not_asked_for_is_not_run() -> None:
    assert "reactions" not in functions("arm", False)
    assert not {"motion", "transmitted"} & sweeps(tuple(functions("arm", False).values()))
    assert "moments" in sweeps(tuple(functions("arm").values()))  # gravity's energy
    assert not {"loads", "clear", "velocities"} & sweeps(tuple(functions("arm").values()))


def test_springs_ask_for_poses_and_velocities_before_the_dynamics() -> None:
    run = [s.sweep for s in own_steps(functions("sprung")["accelerations"]) if isinstance(s, Run)]
    assert run == [
        "rotations",
        "pose",
        "velocities",
        "clear",
        "loads",
        "kinematics",
        "triangularize",
        "back_substitute",
    ]


def test_poses_are_computed_once() -> None:
    """Springs need them, and so do reactions and outputs."""
    for name in ("sprung", "arm"):
        for function in ("reactions", "outputs", "energies"):
            steps = own_steps(functions(name)[function])
            assert steps.count(POSE.values[0]) == (0 if name == "arm" and function == "energies" else 1), (
                name,
                function,
            )


def test_the_state_is_complete_before_it_is_measured() -> None:
    for function in ("energy_sensitivities", "output_sensitivities", "sensitivities"):
        names = [
            s.routine.name if isinstance(s, Perform) else s.sweep
            for s in functions("four_bar")[function].steps
            if isinstance(s, (Perform, Run))
        ]
        assert names.index("start") < names.index("close")
        measured = [n for n in names if n.endswith("_tangents") or n == "balance"]
        assert measured and all(names.index("close") < names.index(n) for n in measured)


def test_columns_of_dependent_coordinates_are_left_out() -> None:
    free_q, free_u = system("four_bar").independent
    among = {s.unit.name: s.among for s in within(functions("four_bar")["jacobians"].steps) if isinstance(s, Columns)}
    assert among["given_dq"] == tuple(free_q) and among["given_du"] == tuple(free_u) and among["dp"] is None
    tree = {s.unit.name: s.among for s in within(functions("arm")["jacobians"].steps) if isinstance(s, Columns)}
    assert set(tree.values()) == {None}


def test_a_routine_with_the_name_of_a_sweep_is_refused() -> None:
    """Both would become functions of one name in generated code."""

    def calling(name: str) -> tuple[Procedure, ...]:
        return (Procedure("f", "", (), (), (Perform(Routine(name, "", (Run("pose"),))),)),)

    check_names(calling("all_poses"))
    with pytest.raises(AssertionError, match="pose"):
        check_names(calling("pose"))
