"""Steps of procedures: their operation counts, and the remaining steps if some have nothing to do."""

from __future__ import annotations

from codegen.program.chosen_steps import pruned, routines
from codegen.program.counting import counted
from codegen.program.procedure import (
    Array,
    Bind,
    Check,
    Columns,
    Copy,
    Formulas,
    Perform,
    Prepare,
    Procedure,
    Routine,
    Run,
    Single,
    Take,
)

U = Array("u", ("nu",), 3)
A = Array("a", ("nu",), 3)
M = Array("M", ("nu", "nu"), 9)
OUT, ALONG = Run("out"), Run("along", True)
F = Formulas("formulas", ("f",))


def procedure(*steps, **more) -> Procedure:
    return Procedure("f", "Does.", (U,), more.pop("results", (A,)), steps, **more)


def test_what_runs_twice_counts_twice() -> None:
    both = Perform(Routine("both", "", (OUT, Run("in"))))
    assert counted(procedure(both, OUT), "start") == ["out", "in", "out"]


def test_what_is_prepared_counts_once() -> None:
    assert counted(procedure(Prepare("x"), OUT, Prepare("y"), Prepare("z", True)), "start") == ["start", "out"]


def test_values_and_tangents_of_formulas_have_one_name() -> None:
    assert counted(procedure(F, F.tangents()), "start") == ["formulas"]
    assert counted(procedure(F, F.tangents(), F), "start") == ["formulas", "formulas"]


def test_each_column_is_a_direction() -> None:
    """What matrices have in common counts once, and formulas of which the values were there before not again."""
    unit = U.tangent()
    columns = [Columns(unit, (F.tangents(), ALONG, *more), (Take(M, A.tangent()),)) for more in ((), (ALONG,))]
    assert counted(procedure(F, OUT, *columns), "start") == ["formulas", "out", "along", "along"]


def test_a_sweep_for_values_has_a_name_of_its_own() -> None:
    assert counted(procedure(Single((ALONG,), (), ()), ALONG), "start") == ["along_1", "along"]


def test_steps_with_nothing_to_do_leave_no_routine() -> None:
    idle = Perform(Routine("idle", "", (Run("dead"),)))
    outer = Perform(Routine("outer", "", (idle, OUT)))
    found = pruned(procedure(outer, idle, Check()), lambda s: s != Run("dead"))
    assert [r.name for r in routines((found,))] == ["outer"]
    assert found.steps == (Perform(Routine("outer", "", (OUT,))), Check())


def test_a_routine_stands_after_those_that_it_performs() -> None:
    inner = Perform(Routine("inner", "", (OUT,)))
    assert [r.name for r in routines((procedure(Perform(Routine("outer", "", (inner,)))),))] == ["inner", "outer"]


def test_results_of_copies_are_the_callers_alone() -> None:
    assert procedure(Copy(A, U)).written_apart() == {"a"}
    assert procedure(OUT).written_apart() == set()
    assert procedure(Bind(U, A)).written_apart() == {"a"}
