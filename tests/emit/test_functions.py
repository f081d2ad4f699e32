"""A procedure's steps as lines of C, and the places of arrays in a call."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

from codegen.emit.c import FLOAT64
from codegen.emit.c.call_memory import call_memory, room
from codegen.emit.c.functions import CFunctions
from codegen.program.procedure import Array, Check, Own, Perform, Procedure, Routine, Run, Zero

U = Array("u", ("nu",), 3)
A = Array("a", ("nu",), 3)
OUT, ALONG = Run("out"), Run("along", True)


def procedure(*steps, **more) -> Procedure:
    return Procedure("f", "Does.", (U,), more.pop("results", (A,)), steps, **more)


def test_own_arrays_of_one_procedure_do_not_overlap() -> None:
    b, c, d = (U.called(n) for n in "bcd")
    lanes = U.tangent("lanes")
    found = call_memory((procedure(Own(b), Own(lanes), Own(c)), procedure(Own(d), Zero(d), Own(c))))
    for together in ((b, lanes, c), (c, d)):
        spans = sorted((found.own[a], found.own[a] + room(a)) for a in together)
        assert all(end <= begin for (_, end), (begin, _) in itertools.pairwise(spans))
    assert found.size == room(b) + room(lanes) + room(c)  # d lies where b does
    assert found.own[d] == found.own[b]
    assert all(at % 8 == 0 for at in found.own.values())


def test_pointers_are_those_of_arrays_that_procedures_have() -> None:
    found = call_memory((procedure(Own(A.tangent()), OUT, seeds=(U.tangent(),)),))
    assert found.fields == {"u": False, "a": True}
    assert found.lane_fields == {"du": False, "da": True}


def test_a_procedure_in_c() -> None:
    checked = Perform(Routine("forward", "Goes forward.", (OUT, Check())))
    p = procedure(checked, ALONG, seeds=(U.tangent(),), results=(A, A.tangent()), widths=(8,))
    printer = CFunctions("model", FLOAT64, call_memory((p,)), lambda what: [], lambda p: ["lay_out(&c, work);"])
    assert printer.routine(checked.routine).signature == "static int forward(call *a)"
    assert printer.routine(checked.routine).lines == ["out(a);", "if (STOPPED(a)) return 1;", "return 0;"]
    assert printer.function(p).lines == [
        "call c;",
        "c.u = u, c.a = a;",
        "DIRECTIONS(call) d;",
        "lay_out(&c, work);",
        "if (forward(&c)) return c.singular;",
        "DIRECTIONS(open)(&d, &c, work);",
        "d.du = (const LANES *)du;",
        "d.da = (LANES *)da;",
        "DIRECTIONS(along)(&d);",
        "return 0;",
    ]


def test_a_call_is_not_cleared_but_what_others_read_is_set() -> None:
    """An initializer clears all members, which takes as long as a sweep; copies over directions read those of other functions."""
    b = A.called("b")
    forward = Perform(Routine("forward", "Goes forward.", (OUT,)))
    p = procedure(forward, ALONG, seeds=(U.tangent(),), results=(A, A.tangent()), widths=(8,))
    q = procedure(forward, results=(b,))
    printer = CFunctions("model", FLOAT64, call_memory((p, q)), lambda what: [], lambda p: ["lay_out(&c, work);"])
    printer.copied = {"b"}
    assert printer.function(p).lines[:2] == ["call c;", "c.u = u, c.a = a, c.b = 0;"]
    assert printer.function(q).lines[:2] == ["call c;", "c.u = u, c.b = b;"]


def test_templates_take_no_decisions() -> None:
    templates = sorted((Path(__file__).parents[2] / "templates").rglob("*.jinja"))
    assert templates
    for path in templates:
        asked = re.findall(
            r"\{%-? *(?:if|elif|else)\b.*?%\}|\{\{[^}]*\bif\b[^}]*\}\}", path.read_text(encoding="utf-8")
        )
        assert not asked, (path.name, asked)
