"""Contestants in C: compiled at several optimisation levels, called in a loop in C, compared and timed in turns.

Times of the same C code differ by a quarter between translation units, and drift with the machine. So every contestant
is a separate library at each level, and all are timed in turns. A round gives, for each, the smallest time of many
batches of about two milliseconds. Times are medians over the rounds at the best level, and ratios are medians of the
ratios of single rounds. The clock counts the CPU time of the thread.
"""

from __future__ import annotations

import argparse
import ctypes
import hashlib
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..runtime.standalone.files.build import Build
from ..runtime.standalone.files.compiler import compiler_version, find_compiler, optimization, processor
from ..runtime.standalone.files.manifest import read_manifest
from ..runtime.standalone.files.user_cache import make_private, user_cache
from . import machine
from .clock import Rounds, in_rounds, repeated

Array = NDArray[np.float64]

LEVELS = ("-O1", "-O2", "-O3")
INSTRUCTIONS = {"native": (), "avx2": ("-mno-avx512f",), "sse2": ("-mno-avx512f", "-mno-avx")}
"""Compiler flags that exclude instructions, by the set of instructions that remains."""

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
    arrays : mapping of str to array, or sequence of arrays
        The arguments by name or number: arguments, results and workspace, float64.
    levels : sequence of str
        Optimisation levels.
    libraries : sequence of Path
        Shared libraries to link, compiled elsewhere.
    instructions : str
        Set of permitted instructions, a key of `INSTRUCTIONS`, in addition to the restriction for all contestants.
    """

    name: str
    files: Mapping[str, str]
    declarations: str
    call: str
    arrays: Mapping[str, Array] | Sequence[Array]
    levels: Sequence[str] = LEVELS
    libraries: Sequence[Path] = ()
    instructions: str = "native"


@dataclass
class Variant:
    """A contestant compiled at one optimisation level."""

    level: str
    arrays: dict[Any, Array] = field(repr=False)
    run: Any = field(repr=False)

    def __post_init__(self) -> None:
        self._pointers = (POINTER * len(self.arrays))(*(x.ctypes.data_as(POINTER) for x in self.arrays.values()))

    def seconds(self, repetitions: int = 1) -> float:
        """Calls the function several times, and returns the total time in seconds."""
        return float(self.run(ctypes.c_long(repetitions), self._pointers))


@dataclass(frozen=True)
class Workshop:
    """Settings common to all contestants: folder of compiled code, instructions, compiler and flags.

    Attributes
    ----------
    folder : Path
    instructions : str
        A key of `INSTRUCTIONS`.
    flags : sequence of str
        Compiler flags for all contestants; no ``-ffast-math``.
    """

    folder: Path
    instructions: str = "native"
    flags: Sequence[str] = ("-march=native",)

    @classmethod
    def of_packages(cls, folder: Path) -> Workshop:
        """The workshop with the flags of generated packages."""
        return cls(folder, flags=optimization())

    @cached_property
    def compiler(self) -> list[str]:
        """The compiler command, as for packages; see `find_compiler`."""
        return find_compiler()

    @cached_property
    def all_flags(self) -> list[str]:
        """Compiler flags, including the flags that exclude instructions."""
        return [*self.flags, *INSTRUCTIONS[self.instructions]]

    @property
    def widest(self) -> str:
        """Name of the widest vector instructions that are permitted."""
        return machine.instructions([*self.compiler, *self.all_flags]) or "no vector instructions"

    def compiled(self, contestant: Contestant, level: str) -> Variant:
        """A compiled contestant with its timing loop, a separate file compiled with ``-O2``; uses the cache."""
        clock = CLOCK.format(declarations=contestant.declarations, call=contestant.call)
        flags = [*self.all_flags, *INSTRUCTIONS[contestant.instructions], "-fPIC"]
        contents = [hashlib.sha256(path.read_bytes()).hexdigest() for path in contestant.libraries]
        folder = self._place("", contestant.files, clock, level, flags, [*map(str, contestant.libraries), *contents])
        library = folder / "contestant.so"
        if not library.exists():
            folder.mkdir(parents=True, exist_ok=True)
            objects = self._objects(contestant.files, level, flags)
            for name, text in {**contestant.files, "clock.c": clock}.items():
                if name.endswith(".h") or name == "clock.c":
                    (folder / name).write_text(text)
            self._run(folder, "-O2", *flags, "-c", "clock.c", "-o", "clock.o")
            linked = [word for path in contestant.libraries for word in (str(path), f"-Wl,-rpath,{path.parent}")]
            self._run(folder, "-shared", *map(str, objects), "clock.o", *linked, "-o", "unfinished.so", "-lm")
            (folder / "unfinished.so").rename(library)
        run = ctypes.CDLL(str(library)).seconds
        run.restype = ctypes.c_double
        given = contestant.arrays
        named = given.items() if isinstance(given, Mapping) else enumerate(given)
        arrays = {name: np.array(x, dtype=np.float64, order="C") for name, x in named}
        return Variant(level, arrays, run)

    def evaluated(self, contestant: Contestant) -> dict[Any, Array]:
        """The arrays after one call, at the last level."""
        variant = self.compiled(contestant, contestant.levels[-1])
        variant.seconds()
        return variant.arrays

    def compete(
        self, contestants: Sequence[Contestant], rounds: int = 9, batches: int = 25, batch: float = 2e-3
    ) -> dict[str, Timing]:
        """Measures the times of contestants that take turns.

        Parameters
        ----------
        contestants : sequence of Contestant
        rounds : int
            Number of rounds. Every round gives the smallest time of the batches, for each level of each contestant.
        batches : int
            Number of batches per round, in turns.
        batch : float
            Approximate time of a batch, s.
        """
        variants = {(c.name, level): self.compiled(c, level) for c in contestants for level in c.levels}
        names = {f"{name} {level}": (name, level) for name, level in variants}
        timed = {label: repeated(variants[key].seconds, batch, warm_up=True) for label, key in names.items()}
        found = {names[label]: x for label, x in in_rounds(timed, rounds, batches).items()}
        result = {}
        for c in contestants:
            levels = {level: found[c.name, level] for level in c.levels}
            best = min(levels, key=lambda level: levels[level].median)
            result[c.name] = Timing(found[c.name, best].seconds, c.name, best, levels, variants[c.name, best])
        return result

    def _objects(self, files: Mapping[str, str], level: str, flags: Sequence[str]) -> list[Path]:
        """Object files of sources; reuses those of earlier contestants."""
        folder = self._place("objects-", files, level, flags)
        sources = [name for name in files if name.endswith(".c")]
        if sources and not folder.exists():
            unfinished = Path(tempfile.mkdtemp(prefix="unfinished-", dir=self.folder))
            for name, text in files.items():
                (unfinished / name).write_text(text)
            for source in sources:
                self._run(unfinished, level, *flags, "-c", source, "-o", f"{source}.o")
            unfinished.rename(folder)
        return [folder / f"{source}.o" for source in sources]

    def _place(self, prefix: str, files: Mapping[str, str], *more: Any) -> Path:
        what = sorted(files.items()), more, compiler_version(tuple(self.compiler)), processor()
        return self.folder / f"{prefix}{hashlib.sha256(repr(what).encode()).hexdigest()[:20]}"

    def _run(self, folder: Path, *arguments: str) -> None:
        subprocess.run([*self.compiler, *arguments], check=True, cwd=folder)


@dataclass(frozen=True)
class Timing(Rounds):
    """Times of a contestant at its best level, and at all levels."""

    name: str
    level: str
    levels: dict[str, Rounds]
    variant: Variant = field(repr=False)

    def nanoseconds(self, per: float = 1.0) -> str:
        """The median in ns, divided by the number of bodies or states, and the level."""
        return f"{self.median / per * 1e9:.{0 if per == 1 else 1}f} ({self.level})"

    def beside(self, other: Timing) -> list[str]:
        """Cells of a table: median of this contestant, name and median of the other one, their ratio, and the range of
        ratios in single rounds."""
        ratios = self.ratios(other)
        spread = f"{min(ratios):.3f} to {max(ratios):.3f}"
        return [self.nanoseconds(), other.name, other.nanoseconds(), f"**{self.ratio(other):.3f}**", spread]

    def __str__(self) -> str:
        return f"{self.name}: " + ", ".join(f"{level} {x.median * 1e9:.0f}" for level, x in self.levels.items())


def default_cache() -> Path:
    """The folder of compiled contestants, kept between runs."""
    return make_private(user_cache() / "benchmarks")


def add_options(parser: argparse.ArgumentParser, rounds: int = 9, batches: int = 25) -> None:
    """Adds options to scripts that compare C functions."""
    parser.add_argument("--instructions", default="native", choices=tuple(INSTRUCTIONS), help="permitted instructions")
    parser.add_argument("--rounds", type=int, default=rounds)
    parser.add_argument("--batches", type=int, default=batches)
    parser.add_argument("--cache", type=Path, default=default_cache(), help="folder of compiled contestants")


def workshop(options: argparse.Namespace) -> Workshop:
    """The workshop that the options of a script describe."""
    return Workshop(options.cache, options.instructions)


# -- functions of generated packages ---------------------------------------------------------------------------------------

APART = ("_calls.c", "_motion.c", "_precise.c", "_four.c", "_states.c", "_threads.c")
"""Sources needed only for calls from Python and for integration over time."""


@dataclass(frozen=True)
class Functions:
    """Generated functions, as sources or in a library.

    Attributes
    ----------
    manifest : mapping
    files : mapping of str to str
    libraries : sequence of Path
    """

    manifest: Mapping[str, Any]
    files: Mapping[str, str]
    libraries: Sequence[Path] = ()

    @classmethod
    def of(cls, source: Any) -> Functions:
        """The functions in the result of `write_solver`."""
        chosen = {n: t for n, t in source.files.items() if n.endswith((".c", ".h")) and not n.endswith(APART)}
        return cls(source.manifest, chosen)

    @classmethod
    def of_package(cls, folder: Path) -> Functions:
        """The functions of a package, with its compiled library."""
        manifest = read_manifest(folder)
        headers = {p.name: p.read_text(encoding="utf-8") for p in folder.glob("*.h")}
        return cls(manifest, headers, [Build(folder, manifest["name"]).library()])

    def sizes(self) -> dict[str, int]:
        """Number of entries of each array, for one state and one direction."""
        m = self.manifest
        q, u, p, inputs = (len(m[f"{x}_names"]) for x in ("coordinate", "speed", "parameter", "input"))
        of = {
            "q": q,
            "u": u,
            "p": p,
            "inputs": inputs,
            "t": 1,
            "udot": u,
            "b": u,
            "energy": 2,
            "M": u * u,
            "inverse_M": u * u,
        }
        of |= {"outputs": len(m["output_names"])} | {f"g{n}": of[n] for n in ("q", "u", "p", "inputs", "t")}
        return of | {f"d{n}": x for n, x in of.items()} | {f"J_{n}": u * of[n] for n in ("q", "u", "p", "inputs", "t")}

    def contestant(
        self, function: str, given: Mapping[str, Any], width: int = 0, name: str = "", *,
        without: Sequence[str] = (), **more: Any,
    ) -> Contestant:  # fmt: skip
        """A contestant that calls a function with the given arguments; other arguments are zero.

        Parameters
        ----------
        function : str
            Name of the function, such as "sensitivities".
        given : mapping of str to array
            Arguments by name; seeds as (width, n).
        width : int
            Number of directions, for functions along seeds.
        without : sequence of str
            Results that are not computed; null pointers are passed.
        more
            Further attributes of the `Contestant`.
        """
        f, sizes, package = self.manifest["functions"][function], self.sizes(), self.manifest["name"]
        arrays: dict[str, Any] = {}
        passed = []
        seeds = f.get("seeds", ())
        for i, argument in enumerate((*f["arguments"], *seeds, *f["results"])):
            along = (width,) if width and argument.startswith("d") else ()
            value = given.get(argument) if i < len(f["arguments"]) + len(seeds) else None
            if value is None:
                value = np.zeros((sizes[argument], *along))
            elif along:
                value = np.transpose(value)
            label = f"{argument} found" if argument in arrays else argument
            arrays[label] = value
            passed.append("(double *)0" if argument in without else f"*a[{i}]" if argument == "t" else f"a[{i}]")
        arrays["work"] = np.zeros(self.manifest["workspace"])
        symbol = f"{package}_{function}_{width}" if seeds else f"{package}_{function}"
        call = f"{symbol}({', '.join([*passed, f'a[{len(passed)}]'])})"
        include = f'#include "{package}.h"'
        return Contestant(name or function, self.files, include, call, arrays, libraries=self.libraries, **more)


__all__ = [
    "LEVELS",
    "Contestant",
    "Functions",
    "Timing",
    "Variant",
    "Workshop",
    "add_options",
    "default_cache",
    "workshop",
]
