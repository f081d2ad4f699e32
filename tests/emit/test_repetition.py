"""Long lists in a short notation, and back."""

from __future__ import annotations

import json

from hypothesis import given
from hypothesis import strategies as st

from codegen.emit.repetition import condensed, repeated
from codegen.runtime.standalone.files.manifest import unrolled

PERIODS = st.lists(
    st.sampled_from(["link({})", "b({}).px", "b({}).qw", "a{}_{}", "wheel", "x07({})", "{}"]), min_size=1, max_size=5
)


@given(
    st.lists(st.tuples(PERIODS, st.integers(0, 40), st.integers(0, 5)), max_size=4),
    st.lists(st.integers(-3, 3), max_size=60),
)
def test_names_and_integers_come_back(parts: list[tuple[list[str], int, int]], integers: list[int]) -> None:
    names = [form.format(start + k, 7) for forms, count, start in parts for k in range(count) for form in forms]
    data = {"names": names, "links": integers + list(range(30)), "braces": ["{}", "{0}"] * 20}
    assert unrolled(json.loads(json.dumps(condensed(data)))) == data


@given(st.lists(st.sampled_from([0.0, -0.0, 1.0, 1, 0.1, 1e300]), max_size=80))
def test_numbers_come_back_to_the_bit(values: list[float]) -> None:
    again = unrolled(json.loads(json.dumps(condensed([*values, *([0.0] * 50)]))))
    assert [repr(v) for v in again] == [repr(v) for v in [*values, *([0.0] * 50)]]


def test_what_is_repeated_is_not_listed() -> None:
    names = [f"body({i}).{c}" for i in range(1, 2001) for c in ("px", "py", "pz", "qw", "qx", "qy", "qz")]
    (found,) = repeated(names)
    assert len(json.dumps(condensed(names))) < 300
    assert found.count == 2000


def test_short_lists_stay_readable() -> None:
    names = [f"link({i})" for i in range(12)]
    assert condensed(names) == names
