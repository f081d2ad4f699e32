"""The core used for measurements: its current speed, and its peak performance.

On a shared machine, other processes make a core slower by half or more, and its caches by a factor of two, for
milliseconds or minutes. Times of two runs are comparable only together with the speed of the core. So two fixed pieces
of work are timed before and after each measurement in a report. One piece resembles a solver; the other uses arrays as
long as the arrays of batches.
"""

from __future__ import annotations

import ctypes
import statistics
from collections.abc import Iterable
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..runtime.standalone.errors import CompileError
from ..runtime.standalone.files.compiler import STANDARD, find_compiler, optimization, run_all
from .clock import Timed, cores, one_core, summary

if TYPE_CHECKING:
    from numpy.typing import NDArray

CORE_C = """\
/* Fixed work, and the peak performance of a core: independent multiply-adds of numbers and of vectors, and sums of
   arrays. */
#include <math.h>
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
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t); /* excludes the time of other processes on the core */
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* Seconds to fill a matrix, to factor it and to solve, as for the equations of a mechanism: sines and cosines, sums
   of few products, and divisions, which compilers do not turn into long vectors. */
#define ROWS 12
double work(long rounds)
{
    static double m[ROWS][ROWS], x[ROWS];
    static volatile double kept;
    double s = 0.3, begin = now();
    for (long r = 0; r < rounds; ++r) {
        for (int i = 0; i < ROWS; ++i) {
            double c = cos(s + i);
            x[i] = sin(s * i);
            for (int j = 0; j <= i; ++j) m[i][j] = (i == j ? ROWS + 1.0 : 0.0) + c * x[j];
        }
        for (int j = 0; j < ROWS; ++j) {
            for (int k = 0; k < j; ++k) m[j][j] -= m[j][k] * m[j][k] * m[k][k];
            for (int i = j + 1; i < ROWS; ++i) {
                double sum = m[i][j];
                for (int k = 0; k < j; ++k) sum -= m[i][k] * m[j][k] * m[k][k];
                m[i][j] = sum / m[j][j];
            }
        }
        for (int i = 0; i < ROWS; ++i)
            for (int k = 0; k < i; ++k) x[i] -= m[i][k] * x[k];
        s = 1e-3 * x[ROWS - 1];
    }
    kept = s;
    return now() - begin;
}

#if defined __x86_64__ || defined __i386__
#define HOLD(x) __asm__ volatile("" : "+x"(x))
#else
#define HOLD(x) __asm__ volatile("" : "+w"(x))
#endif

/* Seconds per operation of 12 independent sums, more than the latency of a multiply-add requires. HOLD keeps each
   sum in a register, and prevents the compiler from combining sums into vectors. */
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
        return (now() - begin) / (24.0 * (lanes) * (double)rounds);                                                    \\
    }
MEASURE(numbers, double, 1)
MEASURE(vectors, vector, WIDTH)

/* Seconds per byte that is read or written, where n numbers are added to n others. The loop is written with four
   vectors at a time, because the speed of a loop over single numbers is limited by its instructions, not by the
   cache. */
typedef double loaded __attribute__((vector_size(8 * WIDTH), aligned(8), may_alias));
double bytes(double *restrict a, const double *restrict b, long n, long rounds)
{
    double begin = now();
    for (long r = 0; r < rounds; ++r) {
        long i = 0;
        for (; i + 4 * WIDTH <= n; i += 4 * WIDTH) {
            loaded *x = (loaded *)(a + i);
            const loaded *y = (const loaded *)(b + i);
            loaded x0 = x[0] + 0.5 * y[0], x1 = x[1] + 0.5 * y[1], x2 = x[2] + 0.5 * y[2], x3 = x[3] + 0.5 * y[3];
            x[0] = x0; x[1] = x1; x[2] = x2; x[3] = x3;
        }
        for (; i < n; ++i) a[i] = a[i] + 0.5 * b[i];
        __asm__ volatile("" : : "r"(a), "r"(b) : "memory");
    }
    return (now() - begin) / (24.0 * (double)n * (double)rounds);
}
"""

WORK = 50
"""Repetitions of the fixed work, about 30 microseconds: short compared with a turn, long compared with the clock's resolution."""

LENGTH = 32_768
"""Length of the two arrays in the second piece of fixed work: too long for the first cache, like arrays of batches."""

FIXED_WORK = ("core", "cache")
"""Names of the fixed work in a `Turn` and in a report."""

WATCHED, MOST_WATCHED = 2e-3, 30
"""After a turn, the fixed work runs once for each `WATCHED` seconds that the turn took, but at most `MOST_WATCHED` times."""

TURNS = 3
"""Number of measurements of each peak performance."""

TRIED = 15
"""Runs of the fixed work on each core for the choice of a core."""

PAGE = 512
"""Number of doubles in a page of memory. Within a page, addresses differ in the bits that a core compares first."""

IN_CACHE, IN_MEMORY = 1536, 8_000_000
"""Lengths of the two arrays whose sums are measured: in the first cache, and far beyond the last cache."""


@dataclass(frozen=True)
class Turn:
    """Time of a turn, and of the fixed work around it.

    Attributes
    ----------
    seconds : float
    core, cache : float
        Time of the fixed work in registers and the first cache, and on longer arrays, s.
    """

    seconds: float
    core: float
    cache: float


@dataclass
class Watched:
    """A contestant whose turns are stored with the times of the fixed work."""

    run: Timed
    core: Core
    turns: list[Turn] = field(default_factory=list)

    def __call__(self) -> float:
        self.turns.append(self.core.turn(self.run))
        return self.turns[-1].seconds


class Core:
    """The compiled functions of `CORE_C`, called in this process.

    Parameters
    ----------
    library : Path
    """

    def __init__(self, library: Path) -> None:
        self.library = library
        self._c = ctypes.CDLL(str(library))
        for name in ("work", "numbers", "vectors", "bytes"):
            getattr(self._c, name).restype = ctypes.c_double
        self._arrays = _two_arrays(LENGTH)

    @classmethod
    def compiled(cls, folder: Path) -> Core:
        """Compiles `CORE_C` to a library in a folder.

        Raises
        ------
        CompileError, NoCompilerError
        """
        source, library = folder / "core.c", folder / "core.so"
        source.write_text(CORE_C, encoding="utf-8")
        command = [*find_compiler(), *STANDARD, *optimization(), str(source), "-o", str(library), "-lm"]
        failed, log = run_all([command])
        if failed:
            raise CompileError(log)
        return cls(library)

    def seconds(self) -> float:
        """Time that the fixed work takes now, s."""
        return float(self._c.work(ctypes.c_long(WORK)))

    def turn(self, run: Timed) -> Turn:
        """One turn of a function that returns its time; the longer the turn, the more fixed work is timed afterwards."""
        core, cache = [self.seconds()], [self._sums(self._arrays, 1)()]
        seconds = run()
        for _ in range(min(max(round(seconds / WATCHED), 1), MOST_WATCHED)):
            core.append(self.seconds())
            cache.append(self._sums(self._arrays, 1)())
        return Turn(seconds, statistics.mean(core), statistics.mean(cache))

    def _sums(self, arrays: tuple[NDArray[np.float64], NDArray[np.float64]], rounds: int) -> Timed:
        """A function that adds arrays repeatedly and returns the time per byte."""
        a, b = (x.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for x in arrays)
        return partial(self._c.bytes, a, b, ctypes.c_long(len(arrays[0])), ctypes.c_long(rounds))

    def fastest(self) -> AbstractContextManager[None]:
        """Restricts the process to the core that is fastest at present, if the system supports this; afterwards all
        cores are allowed.

        Among equal cores, other processes interfere less with this one.
        """

        def taken(core: int) -> float:
            with one_core(core):
                return statistics.median(self.seconds() for _ in range(TRIED))

        return one_core(min(cores(), key=taken, default=None))

    def peaks(self) -> dict[str, list[Turn]]:
        """Times per operation, for scalars and vectors, and per byte, from the first cache and from memory."""
        runs: dict[str, Timed] = {
            name: partial(getattr(self._c, name), ctypes.c_long(400_000)) for name in ("numbers", "vectors")
        }
        for name, n, rounds in (("first cache", IN_CACHE, 5000), ("memory", IN_MEMORY, 1)):
            runs[name] = self._sums(_two_arrays(n), rounds)
        return {name: [self.turn(run) for _ in range(TURNS)] for name, run in runs.items()}


def peaks(folder: Path) -> dict[str, float]:
    """Peak performance of the core: operations per second, with vectors and with scalars, and bytes per second."""
    return {name: 1 / min(turn.seconds for turn in turns) for name, turns in Core.compiled(folder).peaks().items()}


def record(turns: Iterable[Turn]) -> dict[str, Any]:
    """Summary of all turns of a contestant.

    Returns
    -------
    dict
        ``least``, ``median``, ``high`` (at least nine of ten turns were shorter) and ``turns``; ``core`` and ``cache``, the
        medians of the fixed work around them. The fixed work around the shortest turn would not suffice, because cores
        change during a turn.
    """
    known = list(turns)
    beside = {name: statistics.median(getattr(t, name) for t in known) for name in FIXED_WORK}
    return asdict(summary([t.seconds for t in known])) | beside


def _two_arrays(n: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Two arrays of zeros; one starts at a page boundary, the other half a page after a page boundary. Otherwise,
    chance would determine the cost of vectors: whether they cross cache lines, and whether stores to one array delay
    loads from the other.
    """
    apart = -(-n // PAGE) * PAGE + PAGE // 2
    numbers = np.zeros(apart + n + PAGE)
    numbers[::PAGE] = 0.0  # touches all pages before they are timed
    start = -(numbers.ctypes.data // numbers.itemsize) % PAGE
    return numbers[start : start + n], numbers[start + apart : start + apart + n]
