"""Roofline: operations per second against what a core can do (Williams, Waterman and Patterson, 2009)."""

from __future__ import annotations

import ctypes
import statistics
import tempfile
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..bench.timing import one_core
from ..runtime.standalone.compiler import STANDARD, find_compiler, optimization, run_all
from ..runtime.standalone.errors import CompileError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ..runtime import Solver

PEAKS_C = """\
/* What a core can do: fused multiply-adds that wait for nothing, one number or a whole vector at a time, and sums of arrays. */
#include <stddef.h>
#include <time.h>

#if defined __AVX512F__
#define WIDTH 8
#elif defined __AVX__
#define WIDTH 4
#else
#define WIDTH 2
#endif
typedef double vector __attribute__((vector_size(8 * WIDTH)));

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t); /* what others have of the core meanwhile does not count */
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

#if defined __x86_64__ || defined __i386__
#define HOLD(x) __asm__ volatile("" : "+x"(x))
#else
#define HOLD(x) __asm__ volatile("" : "+w"(x))
#endif

/* Operations per second of 12 sums side by side, more than the latency of a multiply-add needs; HOLD keeps each in a register
   and the compiler from making vectors of them. */
#define MEASURE(name, type, lanes)                                                                                     \\
    double name(long rounds)                                                                                           \\
    {                                                                                                                  \\
        type a = (type){0} + 0.999999999, b = (type){0} + 1e-9;                                                        \\
        type s0 = a, s1 = a, s2 = a, s3 = a, s4 = a, s5 = a, s6 = a, s7 = a, s8 = a, s9 = a, s10 = a, s11 = a;         \\
        HOLD(a); HOLD(b);                                                                                              \\
        double begin = now();                                                                                          \\
        for (long n = 0; n < rounds; ++n) {                                                                            \\
            s0 = s0 * a + b; s1 = s1 * a + b; s2 = s2 * a + b; s3 = s3 * a + b;                                        \\
            s4 = s4 * a + b; s5 = s5 * a + b; s6 = s6 * a + b; s7 = s7 * a + b;                                        \\
            s8 = s8 * a + b; s9 = s9 * a + b; s10 = s10 * a + b; s11 = s11 * a + b;                                    \\
            HOLD(s0); HOLD(s1); HOLD(s2); HOLD(s3); HOLD(s4); HOLD(s5);                                                \\
            HOLD(s6); HOLD(s7); HOLD(s8); HOLD(s9); HOLD(s10); HOLD(s11);                                              \\
        }                                                                                                              \\
        type sum = s0 + s1 + s2 + s3 + s4 + s5 + s6 + s7 + s8 + s9 + s10 + s11;                                        \\
        HOLD(sum);                                                                                                     \\
        return 24.0 * (lanes) * (double)rounds / (now() - begin);                                                      \\
    }
MEASURE(numbers, double, 1)
MEASURE(vectors, vector, WIDTH)

/* Bytes per second that are read from an array of n numbers, and written to another one. */
double bytes(double *restrict a, const double *restrict b, long n, long rounds)
{
    double begin = now();
    for (long r = 0; r < rounds; ++r) {
        for (long i = 0; i < n; ++i) a[i] = a[i] + 0.5 * b[i];
        __asm__ volatile("" : : "r"(a), "r"(b) : "memory");
    }
    return 24.0 * (double)n * (double)rounds / (now() - begin);
}
"""

TURNS = 7
"""A peak is the best of so many turns, and its spread goes down to the middle one."""

PAGE = 512
"""Numbers in a page of memory, by whose last bits of addresses a core tells them apart at first."""

IN_CACHE, IN_MEMORY = 1500, 8_000_000
"""Numbers in each of the two arrays of which sums are measured: in the first cache, and far beyond the last."""


@cache
def peaks() -> tuple[dict[str, float], dict[str, float]]:
    """What this core can do: operations per second, one number or vectors at a time, and bytes per second; best and median.

    Raises
    ------
    CompileError, NoCompilerError
    """
    with tempfile.TemporaryDirectory() as folder:
        source, library = Path(folder) / "peaks.c", Path(folder) / "peaks.so"
        source.write_text(PEAKS_C, encoding="utf-8")
        failed, log = run_all([[*find_compiler(), *STANDARD, *optimization(), "-O3", str(source), "-o", str(library)]])
        if failed:
            raise CompileError(log)
        found = ctypes.CDLL(str(library))
        long, pointer = ctypes.c_long, ctypes.POINTER(ctypes.c_double)
        for name in ("numbers", "vectors", "bytes"):
            getattr(found, name).restype = ctypes.c_double
        with one_core():
            result = {
                name: [getattr(found, name)(long(1_000_000)) for _ in range(TURNS)] for name in ("numbers", "vectors")
            }
            for name, n, rounds in (("first cache", IN_CACHE, 20_000), ("memory", IN_MEMORY, 2)):
                a, b = _two_arrays(n)
                result[name] = [
                    found.bytes(a.ctypes.data_as(pointer), b.ctypes.data_as(pointer), long(n), long(rounds))
                    for _ in range(TURNS)
                ]
    return {n: max(x) for n, x in result.items()}, {n: statistics.median(x) for n, x in result.items()}


def _two_arrays(n: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Zeros, that begin where a page does and half a page later.

    Otherwise it is chance that decides what a vector costs: whether it lies in two lines of the cache, and whether what has just
    been written to one array is taken for what is read of the other.
    """
    apart = -(-n // PAGE) * PAGE + PAGE // 2
    numbers = np.zeros(apart + n + PAGE)
    start = -(numbers.ctypes.data // numbers.itemsize) % PAGE
    return numbers[start : start + n], numbers[start + apart : start + apart + n]


def operations(solver: Solver, function: str, directions: int = 0) -> int:
    """Additions, multiplications, divisions and functions of one call, each counted as one."""
    return sum(
        sum(sweep["per_call"].values()) + directions * sum(sweep["per_direction"].values())
        for sweep in solver.operations[function].values()
    )


def points(solver: Solver, times: dict[str, Any]) -> list[dict[str, Any]]:
    """For udot and sensitivities: operations per second, and operations per byte of arguments and results.

    Parameters
    ----------
    times : dict
        ``functions`` of `times.times`.
    """
    found = []
    for name, function, k in (("udot", "accelerations", 0), ("udot + 1 direction", "sensitivities", 1),
                              ("udot + 8 directions", "sensitivities", 8)):  # fmt: skip
        n = operations(solver, function, k)
        moved = 8 * ((solver.nq + 2 * solver.nu + solver.ninputs) * (1 + k) + solver.np * k + 1)
        seconds = times[name]["compiled"]["least"]
        found.append({"name": name, "operations": n, "per_second": n / seconds, "per_byte": n / moved})
    return found
