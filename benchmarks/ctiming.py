"""Compile C functions and time them against each other: one core, alternating, every optimisation level in its own library.

Times of the same C differ by a quarter between translation units and drift with the machine, so contestants are measured
in turns, each as a library of its own at -O1, -O2 and -O3, and compared in pairs: a round measures every contestant (the
fastest of many batches of about two milliseconds), and what is reported is the median over the rounds. The clock counts the
CPU time of the thread.
"""

from __future__ import annotations

import argparse
import ctypes
import hashlib
import os
import statistics
import subprocess
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from codegen.runtime.standalone.compiler import processor
from codegen.runtime.standalone.user_cache import make_private, user_cache

LEVELS = ("-O1", "-O2", "-O3")
FLAGS = ["-march=native", "-fPIC", "-shared"]
"""The same for everybody; no -ffast-math. `restrict_instructions` adds to them."""

INSTRUCTIONS = {"native": [], "avx2": ["-mno-avx512f"], "sse2": ["-mno-avx512f", "-mno-avx"]}
"""Flags that leave out what a machine may not have."""

CLOCK = """\
#include <time.h>
{declarations}
double seconds(long repetitions, double **a)
{{
    struct timespec begin, end;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &begin);
    for (long i = 0; i < repetitions; ++i) {call};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &end);
    return (double)(end.tv_sec - begin.tv_sec) + 1e-9 * (double)(end.tv_nsec - begin.tv_nsec);
}}
"""

POINTER = ctypes.POINTER(ctypes.c_double)


def default_cache() -> Path:
    """Where compiled contestants are kept from run to run."""
    return make_private(user_cache() / "benchmarks")


def add_instructions(parser: argparse.ArgumentParser) -> None:
    """The option that says which instructions everybody may use."""
    parser.add_argument("--instructions", default="native", choices=tuple(INSTRUCTIONS))


def restrict_instructions(which: str) -> str:
    """Let compilers use some of the machine's instructions only; the name of the widest set that is left."""
    FLAGS[1:-2] = INSTRUCTIONS[which]
    command = ["gcc", *FLAGS[:-2], "-dM", "-E", "-x", "c", os.devnull]
    macros = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    known = (
        ("__AVX512F__", "AVX-512"),
        ("__AVX2__", "AVX2"),
        ("__AVX__", "AVX"),
        ("__SSE2__", "SSE2"),
        ("__ARM_NEON", "NEON"),
    )
    return next((name for macro, name in known if f"{macro} " in macros), "no vector instructions")


def use_one_core(core: int | None = None) -> None:
    """Stay on one core (the last, unless told), where the system knows how."""
    if hasattr(os, "sched_setaffinity"):
        allowed = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {allowed[-1] if core is None else core})


@dataclass
class Contestant:
    """A C function with its arguments.

    Attributes
    ----------
    name : str
    files : dict of str to str
        Sources and headers by file name; every ``.c`` is compiled.
    declarations : str
        C declarations for the call, or an ``#include``.
    call : str
        The call, its arguments written ``a[0]``, ``a[1]``, ...
    arrays : list of arrays
        What they point at: arguments, results and workspace, float64.
    levels : sequence of str
        Optimisation levels to compile at.
    libraries : sequence of Path
        Shared libraries to link with, compiled elsewhere.
    instructions : str
        Which of the machine's instructions it may use, of `INSTRUCTIONS`, beside what everybody may not.
    """

    name: str
    files: dict[str, str]
    declarations: str
    call: str
    arrays: Sequence[np.ndarray]
    levels: Sequence[str] = LEVELS
    libraries: Sequence[Path] = ()
    instructions: str = "native"


@dataclass
class Variant:
    """A contestant compiled at one level; `compile_seconds` is zero where the library was in the cache."""

    level: str
    run: ctypes._CFuncPtr = field(repr=False)
    pointers: ctypes.Array = field(repr=False)
    arrays: list[np.ndarray] = field(repr=False)
    compile_seconds: float = 0.0
    repetitions: int = 1

    def seconds(self, repetitions: int) -> float:
        return float(self.run(ctypes.c_long(repetitions), self.pointers))

    def calibrate(self, batch: float) -> None:
        """Set the repetitions of a batch so that it takes about so many seconds."""
        self.repetitions = 1
        while (elapsed := self.seconds(self.repetitions)) < batch / 2 and self.repetitions < 10**8:
            self.repetitions *= 2
        self.repetitions = max(1, int(self.repetitions * batch / max(elapsed, 1e-9)))

    def batch(self) -> float:
        """Seconds per call in one batch; a quarter of it goes before, untimed, to bring code and data into the caches."""
        self.seconds(self.repetitions // 4 + 1)
        return self.seconds(self.repetitions) / self.repetitions


def compile_objects(
    files: dict[str, str], level: str, cache: Path, compiler: str, version: str, flags: Sequence[str]
) -> tuple[list[Path], float]:
    """Objects of a contestant's sources, and the seconds that took; those of an earlier contestant if it had the same."""
    digest = hashlib.sha256(repr((sorted(files.items()), level, flags, version, processor())).encode()).hexdigest()[:20]
    folder, took = cache / f"objects-{digest}", 0.0
    sources = [name for name in files if name.endswith(".c")]
    if not folder.exists():
        unfinished = Path(tempfile.mkdtemp(prefix="unfinished-", dir=cache))
        for name, text in files.items():
            (unfinished / name).write_text(text)
        begin = time.perf_counter()
        for source in sources:
            command = [compiler, level, *flags, "-c", source, "-o", f"{source}.o"]
            subprocess.run(command, check=True, cwd=unfinished)
        took = time.perf_counter() - begin
        unfinished.rename(folder)
    return [folder / f"{source}.o" for source in sources], took


def compile_variant(contestant: Contestant, level: str, cache: Path, compiler: str = "gcc") -> Variant:
    """Compile a contestant and its timing loop (a file of its own, always -O2), or take them from the cache."""
    clock = CLOCK.format(declarations=contestant.declarations, call=contestant.call)
    version = subprocess.run([compiler, "--version"], capture_output=True, text=True, check=True).stdout
    linked = [str(path) for path in contestant.libraries]
    flags = [*FLAGS[:-1], *INSTRUCTIONS[contestant.instructions]]
    contents = [hashlib.sha256(path.read_bytes()).hexdigest() for path in contestant.libraries]
    what = (sorted(contestant.files.items()), clock, level, flags, version, processor(), linked, contents)
    folder = cache / hashlib.sha256(repr(what).encode()).hexdigest()[:20]
    library, took = folder / "contestant.so", 0.0
    if not library.exists():
        folder.mkdir(parents=True, exist_ok=True)
        objects, took = compile_objects(contestant.files, level, cache, compiler, version, flags)
        for name, text in contestant.files.items():
            if name.endswith(".h"):
                (folder / name).write_text(text)
        (folder / "clock.c").write_text(clock)
        subprocess.run([compiler, "-O2", *flags, "-c", "clock.c", "-o", "clock.o"], check=True, cwd=folder)
        linked += [f"-Wl,-rpath,{path.parent}" for path in contestant.libraries]
        command = [compiler, "-shared", *map(str, objects), "clock.o", *linked, "-o", "unfinished.so", "-lm"]
        subprocess.run(command, check=True, cwd=folder)
        (folder / "unfinished.so").rename(library)
    run = ctypes.CDLL(str(library)).seconds
    run.restype = ctypes.c_double
    arrays = [np.ascontiguousarray(a, dtype=np.float64) for a in contestant.arrays]
    pointers = (POINTER * len(arrays))(*(a.ctypes.data_as(POINTER) for a in arrays))
    return Variant(level, run, pointers, arrays, took)


@dataclass
class Timing:
    """What a contestant took: seconds per call at its best level, one figure a round."""

    name: str
    level: str
    rounds: list[float]
    all_levels: dict[str, float]
    variant: Variant = field(repr=False)

    @property
    def median(self) -> float:
        return statistics.median(self.rounds)

    def ratio(self, other: Timing) -> float:
        """Median over the rounds of this one's time over the other's."""
        return statistics.median(a / b for a, b in zip(self.rounds, other.rounds, strict=True))

    def spread(self, other: Timing) -> tuple[float, float]:
        """Least and largest ratio of a round."""
        ratios = [a / b for a, b in zip(self.rounds, other.rounds, strict=True)]
        return min(ratios), max(ratios)


def alternate(
    contestants: Sequence[Contestant],
    cache: Path,
    rounds: int = 9,
    batches: int = 25,
    batch: float = 2e-3,
) -> dict[str, Timing]:
    """Time contestants in turns.

    Parameters
    ----------
    contestants : sequence of Contestant
    cache : path
    rounds : int
        Every round gives one figure for each level of each contestant: the fastest of its batches.
    batches : int
        Batches a round, taken in turns.
    batch : float
        Seconds a batch takes, about.
    """
    variants = {c.name: [compile_variant(c, level, cache) for level in c.levels] for c in contestants}
    everyone = [v for vs in variants.values() for v in vs]
    for v in everyone:
        v.calibrate(batch)
    figures: dict[int, list[float]] = {id(v): [] for v in everyone}
    for _ in range(rounds):
        best = {id(v): float("inf") for v in everyone}
        for _ in range(batches):
            for v in everyone:
                best[id(v)] = min(best[id(v)], v.batch())
        for v in everyone:
            figures[id(v)].append(best[id(v)])
    result = {}
    for name, vs in variants.items():
        medians = {v.level: statistics.median(figures[id(v)]) for v in vs}
        winner = min(vs, key=lambda v: medians[v.level])
        result[name] = Timing(name, winner.level, figures[id(winner)], medians, winner)
    return result


def table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(str(x) for x in line) + " |" for line in lines)
