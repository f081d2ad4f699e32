"""Times of C functions of a package, called from a loop in C: CPU time of the thread, which others disturb least."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..runtime.standalone.build import Build
from .problem import Array
from .timing import Timed

CLOCK = """\
#include <time.h>
/* Seconds of so many calls of a function of n arrays. */
double ordernm_seconds(int (*f)(), long repetitions, int n, double **a)
{
    struct timespec begin, end;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &begin);
    if (n == 5)
        for (long i = 0; i < repetitions; ++i) f(a[0], a[1], a[2], a[3], a[4]);
    else
        for (long i = 0; i < repetitions; ++i) f(a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8]);
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &end);
    return (double)(end.tv_sec - begin.tv_sec) + 1e-9*(double)(end.tv_nsec - begin.tv_nsec);
}
"""
POINTER = ctypes.POINTER(ctypes.c_double)
BATCH = 1e-3
"""Seconds of a turn, about."""


class Clock:
    """Calls functions of packages in a loop in C.

    Parameters
    ----------
    folder : Path
        Where the loop is written and compiled.

    Raises
    ------
    NoCompilerError, CompileError
    """

    def __init__(self, folder: Path) -> None:
        (folder / "clock.c").write_text(CLOCK, encoding="utf-8")
        self.seconds = ctypes.CDLL(str(Build(folder, "ordernm_clock", ["clock.c"]).library())).ordernm_seconds
        self.seconds.restype = ctypes.c_double

    def timed(self, package: Path, model: str, symbol: str, arrays: Sequence[Array]) -> Timed:
        """Seconds of one call of a function, its arrays given in its order: five of them, or nine.

        Parameters
        ----------
        package : Path
            The package's folder.
        model : str
            The model's name.
        symbol : str
            What follows the model's name in the function's.
        """
        if len(arrays) not in (5, 9):
            raise ValueError(f"{symbol} has {len(arrays)} arrays; the loop in C calls functions of 5 or 9")
        library = ctypes.CDLL(str(Build(package, model).library()))
        function = getattr(library, f"{model}_{symbol}")
        kept = [np.ascontiguousarray(x, dtype=np.float64) for x in arrays]
        pointers = (POINTER * len(kept))(*(x.ctypes.data_as(POINTER) for x in kept))

        def run(repetitions: int) -> float:
            return float(self.seconds(function, ctypes.c_long(repetitions), len(kept), pointers))

        repetitions = 1
        while (spent := run(repetitions)) < BATCH / 2 and repetitions < 10**8:
            repetitions *= 2
        repetitions = max(1, int(repetitions * BATCH / max(spent, 1e-9)))

        def timed() -> float:
            run(repetitions // 4 + 1)  # brings code and data into the caches
            return run(repetitions) / repetitions

        return timed
