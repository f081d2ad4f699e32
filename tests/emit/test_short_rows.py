"""Rows of two and three entries of a batch, moved between memory and vectors of states by every instruction set."""

from __future__ import annotations

import ctypes
import subprocess
from pathlib import Path

import numpy as np
import pytest

from codegen.emit.c import C
from codegen.emit.c.vectors import short, short_rows, words

PRELUDE = """
{lanes}
typedef float states __attribute__((vector_size(4*STATES)));
typedef int status __attribute__((vector_size(4*STATES)));
typedef float states_in_memory __attribute__((vector_size(4*STATES), aligned(4), may_alias));
#define CHOSEN(a, b, ...) __builtin_shuffle(a, b, (status){{__VA_ARGS__}})
int count(void) {{ return STATES; }}
{rows}
"""

RUN = """
void run_{n}(float *rows, float *by_entry, float *back)
{{
    states x[3*{n}] = {{0}};
    take_{n}(x, 3, (const states_in_memory *)rows);
    for (int i = 0; i < {n}; ++i) *(states_in_memory *)(by_entry + i*STATES) = x[3*i];
    give_{n}((states_in_memory *)back, x, 3);
}}
"""

SINGLE = next(s for s in C.scalars if s.bytes == 4)


@pytest.mark.parametrize("flags", [["-march=native"], ["-march=native", "-mno-avx512f"], ["-march=native", "-mno-avx"]])
def test_short_rows_go_to_vectors_and_back(tmp_path: Path, flags: list[str]) -> None:
    sizes = short(SINGLE, (7, 3, 2, 3, 1))
    assert sizes == [2, 3]
    lanes = "\n".join(map(str, words(SINGLE)["state_lanes"]))
    text = PRELUDE.format(lanes=lanes, rows="\n".join(short_rows(SINGLE, sizes)))
    (tmp_path / "rows.c").write_text(text + "".join(RUN.format(n=n) for n in sizes))
    command = ["cc", "-O2", *flags, "-Wno-psabi", "-fPIC", "-shared", "rows.c", "-o", "rows.so"]
    subprocess.run(command, cwd=tmp_path, check=True)
    library = ctypes.CDLL(str(tmp_path / "rows.so"))
    for n in sizes:
        rows = np.arange(library.count() * n, dtype="f4").reshape(-1, n)
        by_entry, back = np.zeros(rows.T.shape, "f4"), np.zeros_like(rows)
        getattr(library, f"run_{n}")(*(x.ctypes.data_as(ctypes.c_void_p) for x in (rows, by_entry, back)))
        np.testing.assert_array_equal(by_entry, rows.T)
        np.testing.assert_array_equal(back, rows)


def test_double_precision_has_no_short_rows() -> None:
    """Two of its numbers fill a part of sixteen bytes already."""
    assert short(next(s for s in C.scalars if s.bytes == 8), (1, 2, 3)) == []
