"""The run time of a generated solver: compiles its C once, checks arguments, carries arrays to the compiled functions.

This file is copied as it is into every generated package, where it needs NumPy, and cffi for the C target. What the
generated functions are called and what they take stands in the package's ``model.json``; nothing here knows mechanics.
From top to bottom: errors, compiling, the C target, the NumPy target, the solver.
"""

from __future__ import annotations

import contextlib
import difflib
import functools
import hashlib
import importlib.machinery
import importlib.util
import io
import itertools
import json
import math
import os
import platform
import shlex
import shutil
import signal
import subprocess
import sys
import sysconfig
import tempfile
import threading
import time
import types
import warnings
import weakref
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Shape = tuple[int, ...]
Numbers = ArrayLike | Mapping[str, ArrayLike] | None
"""What a caller may give: an array, or some of its entries by name; None for what is left out."""

TARGET_TOLERANCE = 1e-9
"""Relative difference allowed between the C and the NumPy module, per direction."""

SMALLEST_QUATERNION = 1e-6
"""A quaternion shorter than this has no direction worth a rotation."""


# ---- errors ----------------------------------------------------------------------------------------------------------


class CompileError(RuntimeError):
    """The C compiler refused the generated source; the message says where source and log are kept."""


class PackageError(ValueError):
    """A folder holds no package, or one that is not as generate wrote it: cut short, edited, with a file gone."""


class FlagsError(CompileError, ValueError):
    """A variable of the environment, such as ``ORDERNM_CFLAGS``, cannot be used."""


class NoCompilerError(RuntimeError):
    """There is nothing to compile C with, or nothing to call it through."""


class SingularJointError(np.linalg.LinAlgError):
    """Nothing outboard of a joint has inertia about it, so its acceleration is not determined.

    Attributes
    ----------
    link : str
        The link whose joint it is.
    """

    def __init__(self, link: str, where: str = "") -> None:
        super().__init__(
            f"nothing outboard of joint {link} has inertia about it{where}, so its acceleration is not determined; "
            f"give its body, or one that it carries, mass or inertia"
        )
        self.link = link


class SingularLoopError(SingularJointError):
    """A loop has lost rank: its dependent speeds are not determined by the independent ones.

    Attributes
    ----------
    link : str
        The loop.
    """

    def __init__(self, loop: str, where: str = "") -> None:
        np.linalg.LinAlgError.__init__(
            self,
            f"loop {loop} has lost rank{where}: its dependent joints move nothing of their own there (a dead point, a flattened "
            f"linkage), so their speeds are not determined; step off this configuration, or choose other independent coordinates",
        )
        self.link = loop


class SingularSpringError(SingularJointError):
    """The ends of a spring coincide, so its force has no direction.

    Attributes
    ----------
    link : str
        The spring.
    """

    def __init__(self, spring: str, where: str = "") -> None:
        np.linalg.LinAlgError.__init__(
            self,
            f"the ends of spring {spring} coincide{where}, so its force has no direction; step off this configuration",
        )
        self.link = spring


class AssemblyError(ValueError):
    """A loop cannot be closed.

    Attributes
    ----------
    loop : str
    residual : float
        What is left of its largest condition, in parts of the loop's characteristic length, or radians.
    """

    def __init__(self, loop: str, residual: float, where: str = "") -> None:
        super().__init__(
            f"loop {loop} cannot be closed{where}: {residual:.3g} is left of its conditions (in parts of its characteristic "
            f"length, or radians) with the independent coordinates kept; check lengths, or begin nearer to a closed state"
        )
        self.loop = loop
        self.residual = residual


class TargetsDifferError(ArithmeticError):
    """The compiled C and the NumPy module of one package compute different numbers."""


OPEN_SEED = 1e-7
"""A direction of parameters that opens a loop by more than this, per unit, does not keep its redundant conditions."""

NEWTON_STEPS = 60
SEARCH = tuple(0.5**i for i in range(12))
"""Parts of Newton's step that assembly tries, one after the other."""

STEPS_OFF = (0.02, -0.02, 0.1, -0.1, 0.5, -0.5)
"""rad or m: how far assembly moves dependent coordinates off a guess at which a loop has lost rank, one after the other."""

GUESSES = 16
"""Guesses for dependent coordinates that assembly tries where the given one leads to no closed state, further and further off."""

FURTHEST = 3.0
"""rad or m: how far off the last of them is."""

SEVERAL = 200
"""Dependent coordinates; with more of them no other guesses are tried, they would cost too much."""

ALLOWED = 10.0
"""Tolerances of the model that a dropped condition may be open by, and by which a unit of a parameter may open it, untold."""

CLOSED = 1e-10
"""The largest scaled residual of a closed loop; Newton's method goes on below it as long as it gets better."""

ROUNDING = 1e-14
"""A scaled residual that Newton's method would not mend: assembly leaves such a state as it is."""

# ---- compiling -------------------------------------------------------------------------------------------------------

STANDARD = ("-std=gnu11", "-fPIC", "-shared")
OPTIMIZATION = ("-O2", "-march=native")
"""``ORDERNM_CFLAGS`` in the environment replaces these. Never -ffast-math: pivots are compared with zero."""

COMPILE_SECONDS = 600.0
"""A compiler that takes longer is stopped; ``ORDERNM_COMPILE_SECONDS`` in the environment gives another time."""

LONGEST_WAIT = 1e6
"""Seconds, some days: the system counts those of a wait in milliseconds, and not far."""

VERSION_SECONDS = 60.0
"""The same for its version."""

COMMAND = "$ "
"""Begins the lines of a log that are commands."""

FORBIDDEN = (
    "-ffast-math", "-Ofast", "-ffinite-math-only", "-funsafe-math-optimizations", "-fassociative-math", "-fno-honor-nans",
    "-fno-honor-infinities", "-ffp-model=fast", "-ffp-model=aggressive", "-fsingle-precision-constant",
)  # fmt: skip
"""Flags with which sines and cosines, which are sums of parts, pivots, or checks of numbers that are not finite go wrong."""


def find_compiler() -> list[str]:
    """The command of the C compiler: ``CC`` of the environment, else cc, gcc or clang.

    Raises
    ------
    NoCompilerError
    FlagsError
        ``CC`` has flags that ask for arithmetic that breaks the solver.
    """
    try:
        given = shlex.split(os.environ.get("CC", ""))
    except ValueError as error:
        raise NoCompilerError(f"no C compiler found: CC={os.environ['CC']} is no command ({error})") from None
    _refuse_forbidden("CC", given)
    for command in [given] if given else [["cc"], ["gcc"], ["clang"]]:
        path = shutil.which(command[0])
        if path:
            return [path, *command[1:]]
    what = f"CC={' '.join(given)} is no program" if given else "none of cc, gcc and clang is on the PATH"
    raise NoCompilerError(f"no C compiler found: {what}; install gcc or clang, or set CC")


def optimization() -> list[str]:
    """The flags beside `STANDARD`.

    Raises
    ------
    FlagsError
        ``ORDERNM_CFLAGS`` asks for arithmetic that breaks the solver.
    """
    given = os.environ.get("ORDERNM_CFLAGS")
    try:
        flags = list(OPTIMIZATION) if given is None else shlex.split(given)
    except ValueError as error:
        raise FlagsError(f"ORDERNM_CFLAGS={given} cannot be split into flags: {error}") from None
    _refuse_forbidden("ORDERNM_CFLAGS", flags)
    return flags


def _refuse_forbidden(variable: str, flags: Sequence[str]) -> None:
    for flag in flags:
        if flag in FORBIDDEN:
            raise FlagsError(
                f"{variable} holds {flag}, which breaks sines, cosines and the search for singular joints; use for instance -O3"
            )


def compile_seconds() -> float:
    """How long a compiler may take.

    Raises
    ------
    FlagsError
        ``ORDERNM_COMPILE_SECONDS`` is no time.
    """
    given = os.environ.get("ORDERNM_COMPILE_SECONDS", "")
    try:
        seconds = float(given) if given else COMPILE_SECONDS
    except ValueError:
        seconds = math.nan
    if not seconds > 0.0:
        raise FlagsError(f"ORDERNM_COMPILE_SECONDS={given} is no time in seconds; the default is {COMPILE_SECONDS:g}")
    return min(seconds, LONGEST_WAIT)


def user_cache() -> Path:
    """Where libraries go whose package cannot be written to."""
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "ordernm"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ordernm"


@functools.cache
def _processor() -> str:
    """What -march=native depends on."""
    features = [platform.machine()]
    if sys.platform == "darwin":
        with contextlib.suppress(OSError):
            command = ["sysctl", "-n", "machdep.cpu.brand_string"]
            features.append(subprocess.run(command, capture_output=True, text=True, check=False).stdout)
    with contextlib.suppress(OSError), open("/proc/cpuinfo", encoding="utf-8", errors="replace") as lines:
        for line in lines:
            if line.startswith(("model name", "flags", "Features", "CPU part")):
                features.append(line)
            elif not line.strip():
                break
    return "\n".join(features)


@functools.cache
def _compiler_version(command: tuple[str, ...]) -> str:
    """What tells two compilers of one name apart."""
    try:
        done = subprocess.run(
            [*command, "--version"], stdin=subprocess.DEVNULL, capture_output=True, text=True, errors="replace", check=False,
            timeout=min(compile_seconds(), VERSION_SECONDS),
        )  # fmt: skip
        return done.stdout
    except OSError:
        return ""
    except subprocess.TimeoutExpired:
        raise CompileError(
            f"the C compiler does not answer: {shlex.join([*command, '--version'])} was stopped without an end; set CC to "
            f"another compiler"
        ) from None


class Build:
    """How the C of a package becomes a library.

    The library's name holds three keys, of the source; of flags and processor; of the compiler, and a digest of the
    library itself: opening one that a full disk or a broken copy cut short would kill the process. It appears under that
    name only when it is complete, so several processes may build at once.

    Parameters
    ----------
    folder : Path
        The package.
    name : str
        The model's name.
    sources : list of str
        C files; left out: ``<name>.c``, ``<name>_calls.c``.
    """

    def __init__(self, folder: Path, name: str, sources: Sequence[str] = ()):
        self.folder = folder
        self.name = name
        self.sources = [folder / s for s in sources or [f"{name}.c", f"{name}_calls.c"]]
        self.flags = optimization()
        try:
            self.compiler = find_compiler()
        except NoCompilerError as error:
            self.compiler, self.complaint = [], error
        self.places = [folder]
        with contextlib.suppress(RuntimeError):  # a user without a home
            self.places.append(user_cache() / name)

    def key(self) -> str:
        """Beginning of the library's name; ``*`` for the compiler if there is none."""
        source = hashlib.sha256()
        for file in (*self.sources, *sorted(self.folder.glob(f"{self.name}*.h"))):
            if file.name != f"{self.name}_model.h":  # defaults, which the library does not hold
                source.update(file.read_bytes())
        machine = _key(*STANDARD, *self.flags, _processor())
        compiler = _key(*self.compiler, _compiler_version(tuple(self.compiler))) if self.compiler else "*"
        return f"{self.name}-{source.hexdigest()[:16]}-{machine}-{compiler}"

    def library(self, rebuild: bool = False) -> Path:
        """The library; compiled unless it exists.

        Raises
        ------
        NoCompilerError, CompileError
        """
        key = self.key()
        for place in () if rebuild else self.places:
            for found in sorted(place.glob(f"{key}-*.so")):
                with contextlib.suppress(OSError):
                    if found.stem.endswith(f"-{_digest(found)}"):
                        return found
                    found.unlink()
        if not self.compiler:
            raise self.complaint
        refusals = []
        for place in self.places:
            try:
                place.mkdir(parents=True, exist_ok=True)
                with tempfile.TemporaryDirectory(prefix=".build-", dir=place, ignore_cleanup_errors=True) as temporary:
                    made = Path(temporary) / "library.so"
                    self._compile(made, place / f"{self.name}.log")
                    library = place / f"{key}-{_digest(made)}.so"
                    os.replace(made, library)
                return library
            except OSError as error:  # read-only, not ours, full, or a folder is where the library shall be
                refusals.append(str(error))
        raise CompileError(f"no folder to write the library of {self.name} to: {'; '.join(refusals)}")

    def _compile(self, output: Path, log_file: Path) -> None:
        refused, log = self._run(self.flags, output)
        complaints = [line for line in log.splitlines() if not line.startswith(COMMAND)]
        if refused and "-march=native" in self.flags and any("march" in line for line in complaints):
            refused, log = self._run([f for f in self.flags if f != "-march=native"], output)
        if not refused and output.exists():
            with contextlib.suppress(OSError):
                log_file.unlink()
            return
        log = log or f"{shlex.join(self.compiler)} reported no error, but wrote no library\n"
        if not self._compiles(output):
            log = f"{shlex.join(self.compiler)} compiles no C: it fails on a file of one line too; set CC to a C compiler\n{log}"
        log_file.write_text(log, encoding="utf-8")
        sources = ", ".join(map(str, self.sources))
        first = "\n".join(log.splitlines()[:12])
        raise CompileError(f"the C compiler failed on {sources}; the whole log is in {log_file}:\n{first}")

    def _compiles(self, output: Path) -> bool:
        """Whether the compiler compiles anything."""
        source, made = output.with_name("one_line.c"), output.with_name("one_line.o")
        source.write_text("int one_line(void) { return 0; }\n", encoding="utf-8")
        refused, _ = _run_all([[*self.compiler, "-c", "-o", str(made), str(source)]])
        return not refused and made.exists()

    def _run(self, flags: list[str], output: Path) -> tuple[bool, str]:
        """Compile the sources, several at once, and link them; whether that was refused, and the log."""
        common = [*self.compiler, *STANDARD, *flags]
        if len(self.sources) == 1:
            return _run_all([[*common, "-o", str(output), str(self.sources[0]), "-lm"]])
        objects = [output.with_name(f"{s.stem}.o") for s in self.sources]
        parts = [
            [*(f for f in common if f != "-shared"), "-c", "-o", str(o), str(s)]
            for s, o in zip(self.sources, objects, strict=True)
        ]
        refused, log = _run_all(parts)
        if refused:
            return refused, log
        return _run_all([[*common, "-o", str(output), *map(str, objects), "-lm"]])


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()[:8]


def _key(*parts: str) -> str:
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:8]


@contextlib.contextmanager
def _interrupts_wait() -> Iterator[None]:
    """Ctrl-C meanwhile takes effect in the end. Signals reach the main thread only."""
    usual = signal.getsignal(signal.SIGINT)
    if usual is None or threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[tuple[int, Any]] = []
    signal.signal(signal.SIGINT, lambda number, frame: came.append((number, frame)))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, usual)
        if came and callable(usual):
            usual(*came[0])


def _run_all(commands: list[list[str]]) -> tuple[bool, str]:
    """Run commands side by side; whether one failed, and what they said.

    Raises
    ------
    CompileError
        One took too long. All are stopped then, with what they have started, and also when the user interrupts.
    """
    log = []
    failed = False
    running: list[subprocess.Popen[bytes]] = []
    seconds = compile_seconds()
    end = time.monotonic() + seconds
    try:
        with _interrupts_wait():  # a process is known before anything can end its start
            for c in commands:
                running.append(
                    subprocess.Popen(
                        c,
                        stdin=subprocess.DEVNULL,
                        stdout=subprocess.PIPE,
                        stderr=subprocess.STDOUT,
                        start_new_session=True,
                    )
                )
        for command, process in zip(commands, running, strict=True):
            said, _ = process.communicate(timeout=max(0.01, end - time.monotonic()))
            if process.returncode:
                failed = True
                text = said.decode(errors="replace")
                log.append(f"{COMMAND}{shlex.join(command)}\n{text}exit code {process.returncode}\n")
    except OSError as error:
        return True, f"{COMMAND}{shlex.join(commands[len(running)])}\n{error}\n"
    except subprocess.TimeoutExpired:
        raise CompileError(
            f"the C compiler was stopped after {seconds:g} s without an end: {shlex.join(command)}; if it needs longer, set "
            f"ORDERNM_COMPILE_SECONDS to more seconds, else set CC to another compiler"
        ) from None
    finally:
        for process in running:
            if process.poll() is None:
                with contextlib.suppress(OSError):
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()
            if process.stdout is not None:
                process.stdout.close()
    return failed, "".join(log)


def compile_library(folder: Path, name: str, sources: Sequence[str] = ()) -> Path:
    """Compile the C of a package unless that has been done; see `Build`.

    Raises
    ------
    NoCompilerError, CompileError
    """
    return Build(folder, name, sources).library()


# ---- functions of a package ------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Function:
    """A generated function, as the manifest describes it.

    Attributes
    ----------
    arguments, results : tuple of str
        In the order of the generated code.
    seeds : dict of str to int
        With the number of entries, in that order as well.
    shapes : tuple of tuple of int
        Of the results, after batch axes.
    derived : tuple of bool
        Whether a result is a derivative along the seeds.
    widths : tuple of int
        Numbers of directions that the C takes at once; empty for a function without directions.
    """

    name: str
    arguments: tuple[str, ...]
    seeds: dict[str, int]
    results: tuple[str, ...]
    shapes: tuple[Shape, ...]
    derived: tuple[bool, ...]
    widths: tuple[int, ...]


def split(k: int, widths: Iterable[int]) -> list[int]:
    """Widths that cover k directions with the least work; the last may be wider than what remains.

    Every call does the forward dynamics again, and eight directions in lanes cost little more than one: one call that
    is too wide beats two that fit.
    """
    allowed = sorted(widths)
    parts = [allowed[-1]] * (k // allowed[-1])
    rest = k % allowed[-1]
    return [*parts, next(w for w in allowed if w >= rest)] if rest else parts


TAKES = {
    "values": "intptr_t, intptr_t, intptr_t, intptr_t, double, intptr_t",
    "matrices": "intptr_t, intptr_t, intptr_t, intptr_t, double, intptr_t, intptr_t, intptr_t, intptr_t, intptr_t",
    "along": "intptr_t, intptr_t, intptr_t, intptr_t, double, long, "
             "intptr_t, intptr_t, intptr_t, intptr_t, intptr_t, intptr_t, intptr_t",
}  # fmt: skip
"""What ``NAME_take_values`` and the others of ``NAME_calls.c`` take after the desk."""

CALLER = "".join(f"int ordernm_{n}(void *, {taken});\n" for n, taken in TAKES.items())
"""What cffi's API mode compiles: calls of those, for all packages."""


def _caller_source() -> str:
    """Definitions of `CALLER`."""
    lines = ["#include <stdint.h>"]
    for name, taken in TAKES.items():
        kinds = taken.split(", ")
        given = ", ".join(f"{kind} x{i}" for i, kind in enumerate(kinds))
        passed = ", ".join(f"x{i}" for i in range(len(kinds)))
        # a desk begins with the function to call
        lines.append(f"static int ordernm_{name}(void *desk, {given})")
        lines.append(f"{{ return (*(int (**)(void *, {taken}))desk)(desk, {passed}); }}")
    return "\n".join([*lines, ""])


class CallerBuild(Build):
    """How cffi's caller is compiled: once for a user's Python, whatever the model is.

    Raises
    ------
    CompileError
        There are no headers of Python.
    """

    def __init__(self, folder: Path, wanted: bool):
        super().__init__(folder, "ordernm_call")
        self.wanted = wanted
        include = sysconfig.get_path("include")
        if not os.path.exists(os.path.join(include, "Python.h")):
            raise CompileError(f"no Python.h in {include}")
        self.flags = ["-O1", "-I", include]
        self.places = [*self.places[1:], folder]

    def key(self) -> str:
        import cffi

        python = _key(
            cffi.__version__, str(sysconfig.get_config_var("SOABI")), _caller_source(), *STANDARD, *self.flags
        )
        machine = _key(platform.machine(), *self.compiler, _compiler_version(tuple(self.compiler)))
        return f"{self.name}-{python}-{machine if self.compiler else '*'}"

    def _compile(self, output: Path, log_file: Path) -> None:
        from cffi import FFI

        ffi = FFI()
        ffi.cdef(CALLER)
        ffi.set_source("_ordernm_call", _caller_source())
        source = output.with_name("ordernm_call.c")
        with contextlib.redirect_stdout(io.StringIO()):  # cffi tells what it writes
            ffi.emit_c_code(str(source))
        self.sources = [source]
        # what fails is done without, and leaves no log, unless it was asked for
        super()._compile(output, log_file if self.wanted else output.with_name(log_file.name))


@functools.cache
def _load_caller(path: str) -> Any:
    """The functions of a compiled caller."""
    loader = importlib.machinery.ExtensionFileLoader("_ordernm_call", path)
    spec = importlib.util.spec_from_file_location("_ordernm_call", path, loader=loader)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    loader.exec_module(module)
    return module.lib


_refused: set[str] = set()
"""Keys of callers that could not be compiled, which are not tried again."""


def find_caller(folder: Path) -> Any:
    """The functions of `CALLER` in cffi's API mode; None where ABI mode must serve.

    ``ORDERNM_CFFI`` of the environment asks for one of them: ``api`` or ``abi``.

    Raises
    ------
    FlagsError, CompileError
    """
    mode = os.environ.get("ORDERNM_CFFI", "")
    if mode not in ("", "abi", "api"):
        raise FlagsError(f"ORDERNM_CFFI is {mode!r}; allowed are 'api' and 'abi', or nothing for the first that works")
    if mode == "abi":
        return None
    try:
        build = CallerBuild(folder, mode == "api")
        key = build.key()
        if mode != "api" and key in _refused:
            return None
        try:
            return _load_caller(str(build.library()))
        except (CompileError, NoCompilerError, ImportError, OSError):
            _refused.add(key)
            raise
    except (CompileError, NoCompilerError, ImportError, OSError) as error:
        if mode == "api":
            raise CompileError(f"ORDERNM_CFFI=api: cffi's API mode cannot be used: {error}") from None
        return None


ARGUMENTS = ("q", "u", "p", "inputs", "udot", "b")
SEEDS = ("dq", "du", "dp", "dinputs", "dudot", "db", "dt")
"""Arguments and seeds in the order of their pointers in ``NAME_calls.c``; `t` is passed as a number."""

SLOT = {n: i for i, n in enumerate((*ARGUMENTS, *SEEDS, "default_p", "default_inputs", "work", "lanes", "results"))}
STATE = ("q", "u", "p", "inputs", "t")
"""What the members of a solver that take a state take, in order."""

SHORT = (
    "accelerations", "sensitivities", "jacobians", "coordinate_rates", "coordinate_rate_sensitivities", "energies",
    "energy_sensitivities", "outputs", "output_sensitivities",
)  # fmt: skip
"""Functions that have a short way: those of a state and its seeds."""

ARRAY_HEAD = """\
typedef struct { char *data; int dimensions; intptr_t *shape, *strides; void *base, *type; int flags; } ordernm_array;
typedef struct { void *take, *function; intptr_t head; void *arrays, *doubles; double *x[32]; } ordernm_desk;
"""
"""The same stand in ``NAME_calls.c``: arrays as NumPy's C interface publishes them, and what a thread calls with."""


@functools.cache
def _head_of_objects() -> int:
    """Bytes of a Python object before what an array adds; 0 where arrays are not laid out as `ARRAY_HEAD` says."""
    if sys.implementation.name != "cpython":
        return 0
    from cffi import FFI

    ffi = FFI()
    ffi.cdef(ARRAY_HEAD)
    head = object.__basicsize__
    if np.ndarray.__basicsize__ < head + ffi.sizeof("ordernm_array"):
        return 0
    for x in (np.zeros(3), np.zeros((2, 5)), np.zeros((4, 6))[1:, ::2], np.zeros((3, 2)).T, np.zeros(0)):
        x.flags.writeable = x.ndim == 2
        seen = ffi.cast("ordernm_array *", id(x) + head)
        if (
            ffi.cast("void **", id(x) + head)[-1] != ffi.cast("void *", id(np.ndarray))
            or seen.dimensions != x.ndim
            or int(ffi.cast("intptr_t", seen.data)) != x.__array_interface__["data"][0]
            or any(seen.shape[i] != x.shape[i] or seen.strides[i] != x.strides[i] for i in range(x.ndim))
            or seen.type != ffi.cast("void *", id(x.dtype))
            or seen.flags != x.flags.num
        ):
            return 0
    return head


class Desk(threading.local):
    """What one thread calls the functions of a target with: the short way of a function is the attribute of its name.

    It takes the arguments of the solver's member, and returns the results, or None if they are not plain arrays of one valid
    state. Then the long way takes them, and tells what is wrong.
    """

    def __init__(self, target: CTarget):
        self.target = target
        for name in SHORT:
            setattr(self, name, functools.partial(self._first, name))

    def _first(self, name: str, *arguments: Any) -> Any:
        """The first call of a thread."""
        way = self.target.short_way(name, self.work)
        setattr(self, name, way)
        return way(*arguments)

    @functools.cached_property
    def work(self) -> Any:
        """This thread's workspace."""
        return self.target.pointer(np.empty(self.target.workspace))


def _no_short_way(*arguments: Any) -> None:
    return None


class WatchedDesk:
    """A desk without short ways along directions, for models with parameters that open loops: the long way looks for them."""

    def __init__(self, desk: Any):
        self._desk = desk

    def __getattr__(self, name: str) -> Any:
        return _no_short_way if name == "jacobians" or name.endswith("sensitivities") else getattr(self._desk, name)


NO_DESK = types.SimpleNamespace(**dict.fromkeys(SHORT, _no_short_way))
"""Stands for `Desk` where there is no short way."""


class CTarget:
    """The compiled functions of a package, called through cffi, which releases the GIL.

    Raises
    ------
    NoCompilerError, CompileError
    """

    name = "c"

    def __init__(self, folder: Path, manifest: Mapping[str, Any], functions: Mapping[str, Function]):
        try:
            from cffi import FFI
        except ImportError:
            raise NoCompilerError("cffi is not installed, and the C target needs it: pip install cffi") from None
        self.ffi = FFI()
        self.model: str = manifest["name"]
        self.links: list[str] = manifest["links"]
        self.loops: list[str] = manifest.get("loops", [])
        self.springs: list[str] = manifest.get("springs", [])
        self.workspace: int = manifest["workspace"]
        self.functions = functions
        self.defaults = np.array(manifest["parameters"], float), np.zeros(len(manifest["input_names"]))
        self.build = Build(folder, self.model, manifest.get("sources", ()))
        self.library = self._open()
        caller = find_caller(folder)
        self.mode = "abi" if caller is None else "api"
        self._caller = caller
        self.ffi.cdef(ARRAY_HEAD)
        self._doubles = self.ffi.typeof("double[]")
        self._calls: dict[str, Any] = {}
        self._batches: dict[tuple[str, int], Callable[..., int]] = {}
        self._lock = threading.Lock()
        self._zeros = self.pointer(np.zeros(8))
        self._alive: weakref.WeakKeyDictionary[Any, Any] = weakref.WeakKeyDictionary()
        self.desk = Desk(weakref.proxy(self))

    def _open(self) -> Any:
        path = self.build.library()
        try:
            return self._opened(path)
        except OSError:  # damaged, or of another machine
            path = self.build.library(rebuild=True)
        try:
            return self._opened(path)
        except OSError as error:
            raise CompileError(f"{path} was compiled but cannot be opened: {error}") from None

    def _opened(self, path: Path) -> Any:
        try:
            return self.ffi.dlopen(str(path))
        except UnicodeEncodeError:  # a name that is no text in the user's locale: cffi takes texts only
            import ctypes

            self._ctypes_library = ctypes.CDLL(str(path))
            return self.ffi.dlopen(self.ffi.cast("void *", self._ctypes_library._handle))

    def pointer(self, x: Array) -> Any:
        """Where an array begins; keeps it alive."""
        return self.ffi.from_buffer(self._doubles, x)

    def _function(self, f: Function) -> Any:
        """The C function with the one signature of all; declared when first called, which keeps loading quick."""
        call = self._calls.get(f.name)
        if call is None:
            symbol = f"{self.model}_call_{f.name}"
            with self._lock:
                self.ffi.cdef(f"int {symbol}(double **, long, double, long);", override=True)
                call = self._calls[f.name] = getattr(self.library, symbol)
        return call

    def _take(self, kind: str, f: Function, desk: Any) -> Callable[..., int]:
        """What calls a function with arrays' objects: the desk, ``id`` of each, 0 for what is left out."""
        symbol = f"{self.model}_take_{kind}"
        desk.function = self.ffi.cast("void *", self._function(f))
        with self._lock:
            self.ffi.cdef(f"int {symbol}(void *, {TAKES[kind]});", override=True)
            take: Callable[..., int] = getattr(self.library, symbol)
        desk.take = self.ffi.cast("void *", take)
        return take if self._caller is None else getattr(self._caller, f"ordernm_{kind}")

    def _batch_function(self, f: Function, width: int) -> Callable[..., int]:
        """The C function that loops over a batch."""
        call = self._batches.get((f.name, width))
        if call is None:
            symbol = f"{self.model}_{f.name}" + (f"_{width}" if width else "") + "_batch"
            types = ["long", "long *", *["const double *, long"] * (len(f.arguments) + len(f.seeds))]
            types += ["double *"] * (len(f.results) + 1)
            with self._lock:
                self.ffi.cdef(f"int {symbol}({', '.join(types)});", override=True)
                call = self._batches[f.name, width] = getattr(self.library, symbol)
        return call

    def _nothing(self, size: int) -> Any:
        """So many zeros: a seed that was left out."""
        zeros = self._zeros  # another thread may put shorter ones there meanwhile
        if len(zeros) < size:
            zeros = self._zeros = self.pointer(np.zeros(size))
        return zeros

    def _lanes_needed(self, f: Function) -> int:
        """Numbers that seeds and derivatives take in the widest call."""
        derived = sum(math.prod(s) for s, d in zip(f.shapes, f.derived, strict=True) if d)
        return (sum(f.seeds.values()) + derived) * max(f.widths, default=0)

    # -- one state -----------------------------------------------------------------------------------------------------

    def short_way(self, name: str, work: Any) -> Callable[..., Any]:
        """The short way of a function: the C finds the numbers in the arrays' objects, and checks them."""
        f = self.functions.get(name)
        head = _head_of_objects()
        if f is None or not head:
            return _no_short_way
        desk = self.ffi.new("ordernm_desk *")
        desk.head = head
        desk.arrays, desk.doubles = (self.ffi.cast("void *", id(x)) for x in (np.ndarray, np.dtype(np.float64)))
        unasked = np.empty(f.shapes[0])  # udot beside its Jacobians
        x, kept = self._table({}, [unasked], work, np.empty(self._lanes_needed(f)))
        self.ffi.memmove(desk.x, x, self.ffi.sizeof("double *") * len(x))
        self._alive[desk] = kept
        if f.seeds:
            return _short_along(self._take("along", f, desk), desk, f.shapes[0], f.shapes[1])
        if name == "jacobians":
            nu, np_, ninputs = f.shapes[0][0], *map(len, self.defaults)
            shapes = {
                "q": dict(zip(f.results, f.shapes, strict=True))["J_q"],
                "u": (nu, nu),
                "p": (nu, np_),
                "inputs": (nu, ninputs),
                "t": (nu,),
            }
            return _short_jacobians(self._take("matrices", f, desk), desk, shapes, f.results[1:])
        return _short_values(self._take("values", f, desk), desk, f.shapes[0])

    def _table(self, given: Mapping[str, Array], results: Sequence[Array], work: Any, lanes: Array) -> tuple[Any, Any]:
        """The pointers of a call, and what must live as long as they."""
        pointers = {n: self.pointer(a) for n, a in given.items()}
        pointers |= {n: self.pointer(a) for n, a in zip(("default_p", "default_inputs"), self.defaults, strict=True)}
        pointers |= {"work": work, "lanes": self.pointer(lanes)}
        x = self.ffi.new("double *[]", SLOT["results"] + len(results))
        for name, pointer in pointers.items():
            x[SLOT[name]] = pointer
        of_results = [self.pointer(r) for r in results]
        for i, pointer in enumerate(of_results):
            x[SLOT["results"] + i] = pointer
        return x, (pointers, of_results)

    def _single(
        self, f: Function, arrays: Mapping[str, Any], seeds: Mapping[str, Array], k: int, results: Sequence[Array]
    ) -> None:
        """Compute the results of one state, directions as rows."""
        given = {n: a for n, a in arrays.items() if n in SLOT}
        given |= {s: np.ascontiguousarray(a) for s, a in seeds.items() if s in f.seeds}
        x, kept = self._table(given, results, self.desk.work, np.empty(self._lanes_needed(f)))
        bits = sum(1 << SLOT[n] for n in given)
        status = self._function(f)(x, bits, arrays.get("t", 0.0), k)
        del kept
        if status > 0:
            raise self.singular(status)

    # -- any number of states ------------------------------------------------------------------------------------------

    def values(self, f: Function, arrays: Mapping[str, Any], batch: Shape, out: Sequence[Array] = ()) -> list[Array]:
        """Results (*batch, *shape) of a function without directions, in `out` if there is one.

        `arrays` hold (..., n), with leading axes that broadcast to the batch; ``t`` is a float or (...).
        """
        results = list(out) or [_empty(batch + shape) for shape in f.shapes]
        if batch:
            self._batch(f, 0, [self._row(arrays[a], batch, a == "t") for a in f.arguments], results, batch)
        else:
            self._single(f, arrays, {}, 0, results)
        return results

    def singular(self, status: int, where: str = "") -> SingularJointError:
        """The error for what a compiled function has returned."""
        links, loops = len(self.links), len(self.loops)
        if status > links + loops:
            return SingularSpringError(self.springs[status - 1 - links - loops], where)
        if status > links:
            return SingularLoopError(self.loops[status - 1 - links], where)
        return SingularJointError(self.links[status - 1], where)

    def along(
        self,
        f: Function,
        arrays: Mapping[str, Any],
        seeds: Mapping[str, Array],
        k: int,
        batch: Shape,
        out: Sequence[Array] = (),
    ) -> list[Array]:
        """Results of a function over directions: (*batch, *shape), derivatives (k, *batch, *shape), in `out` if there is one.

        `seeds` hold (k, ..., n) with as many batch axes as the batch, ``dt`` (k, ..., 1); missing ones are zero.
        """
        results = list(out) or [
            _empty(((k,) if d else ()) + batch + s) for s, d in zip(f.shapes, f.derived, strict=True)
        ]
        if not batch:
            self._single(f, arrays, seeds, k, results)
            return results
        count = math.prod(batch)
        arguments = [self._row(arrays[a], batch, a == "t") for a in f.arguments]
        start = 0
        for width in split(k, f.widths) or [min(f.widths)]:  # without directions there are values still
            end = min(start + width, k)
            given = list(arguments)
            for s, n in f.seeds.items():
                if s in seeds:
                    given.append(self._lanes(seeds[s][start:end], width, batch, count))
                else:
                    given.append((self._nothing(n * width), 0))
            taken: list[Array] = []
            lanes: list[tuple[Array, Array]] = []
            for result, shape, derived in zip(results, f.shapes, f.derived, strict=True):
                if derived and (width > 1 or start == end):
                    taken.append(_empty((count, math.prod(shape), width)))
                    lanes.append((taken[-1], result[start:end]))
                else:
                    taken.append(result[start] if derived else result)
            self._batch(f, width, given, taken, batch)
            for lane, part in lanes:
                part[...] = np.moveaxis(lane[..., : end - start], -1, 0).reshape(part.shape)
            start = end
        return results

    def _batch(
        self, f: Function, width: int, given: Sequence[tuple[Any, int]], results: Sequence[Array], batch: Shape
    ) -> None:
        """Run over the states of a batch, in C; given are pointers and their steps from state to state, in doubles."""
        failed = self.ffi.new("long *")
        pointers = [self.pointer(r) for r in results]
        call = self._batch_function(f, width)
        status = call(math.prod(batch), failed, *itertools.chain.from_iterable(given), *pointers, self.desk.work)
        if status:
            state = ", ".join(str(int(j)) for j in np.unravel_index(failed[0], batch))
            raise self.singular(status, f" (state [{state}] of the batch)")

    def _row(self, x: Any, batch: Shape, scalar: bool) -> tuple[Any, int]:
        """Where an argument begins, and its step from state to state."""
        if scalar:
            if isinstance(x, float):
                return self.pointer(np.array([x])), 0
            return self.pointer(np.ascontiguousarray(np.broadcast_to(x, batch))), 1
        if x.ndim == 1:
            return self.pointer(x), 0
        n = x.shape[-1]
        return self.pointer(np.ascontiguousarray(np.broadcast_to(x, (*batch, n)))), n

    def _lanes(self, part: Array, width: int, batch: Shape, count: int) -> tuple[Any, int]:
        """Some directions of a seed, direction last, and the step; lanes beyond its end are zero."""
        m, n = len(part), part.shape[-1]
        if part.size == m * n:  # the same for all states
            if width == m == 1:
                return self.pointer(np.ascontiguousarray(part)), 0
            lanes = np.zeros((n, width))
            lanes[:, :m] = part.reshape(m, n).T
            return self.pointer(lanes), 0
        lanes = np.zeros((count, n, width))
        lanes[..., :m] = np.moveaxis(np.broadcast_to(part, (m, *batch, n)).reshape(m, count, n), 0, -1)
        return self.pointer(lanes), n * width


def _short_values(call: Callable[..., int], desk: Any, shape: Shape) -> Callable[..., Any]:
    """The short way of a function without directions."""
    empty, ndarray = np.empty, np.ndarray

    def short(q: Any, u: Any, p: Any, inputs: Any, t: Any, out: Any = None) -> Any:
        if type(t) is not float and not isinstance(t, float):
            return None
        if out is None:
            result = empty(shape)
        elif type(out) is ndarray and out.shape == shape:
            result = out
        else:
            return None
        p = 0 if p is None else id(p)
        inputs = 0 if inputs is None else id(inputs)
        return None if call(desk, id(q), id(u), p, inputs, t, id(result)) else result

    return short


def _short_jacobians(
    call: Callable[..., int], desk: Any, shapes: Mapping[str, Shape], computed: Sequence[str]
) -> Callable[..., Any]:
    """The short way of `Solver.jacobians`; matrices that are not computed are zero."""
    new_q, new_u, new_p, new_inputs, new_t = (np.empty if f"J_{n}" in computed else np.zeros for n in JACOBIANS)
    q_shape, u_shape, p_shape, inputs_shape, t_shape = (shapes[n] for n in JACOBIANS)

    def short(q: Any, u: Any, p: Any, inputs: Any, t: Any, out: Any = None) -> Any:
        if out is not None or (type(t) is not float and not isinstance(t, float)):
            return None
        J_q, J_u, J_p = new_q(q_shape), new_u(u_shape), new_p(p_shape)
        J_inputs, J_t = new_inputs(inputs_shape), new_t(t_shape)
        p = 0 if p is None else id(p)
        inputs = 0 if inputs is None else id(inputs)
        status = call(
            desk, id(q), id(u), p, inputs, t, id(J_q), id(J_u), id(J_p), id(J_inputs), id(J_t)
        )  # fmt: skip
        return None if status else Jacobians(J_q, J_u, J_p, J_inputs, J_t)

    return short


def _short_along(call: Callable[..., int], desk: Any, value_shape: Shape, derived_shape: Shape) -> Callable[..., Any]:
    """The short way of a function over directions."""
    empty, ndarray, array = np.empty, np.ndarray, np.array

    def short(q: Any, u: Any, p: Any, inputs: Any, t: Any, seeds: Any, out: Any = None) -> Any:
        if type(t) is not float and not isinstance(t, float):
            return None
        dq, du, dp, dinputs, dt = seeds
        if type(dt) is float:
            dt = array([dt])
        first = dq
        if first is None:
            first = du if du is not None else dp if dp is not None else dinputs if dinputs is not None else dt
        if type(first) is not ndarray:
            return None
        axes = first.ndim
        if axes == 2 or (axes == 1 and first is dt):
            k = len(first)
        elif axes == 1:
            k = 1
        else:
            return None
        if out is None:
            value, derivative = empty(value_shape), empty((k, *derived_shape))
        else:
            if not (isinstance(out, (tuple, list)) and len(out) == 2 and all(type(x) is ndarray for x in out)):
                return None
            value, derivative = out
            if value.shape != value_shape or derivative.shape != (k, *derived_shape):
                return None
            if np.may_share_memory(value, derivative):
                return None
        status = call(
            desk, id(q), id(u), 0 if p is None else id(p), 0 if inputs is None else id(inputs), t, k,
            0 if dq is None else id(dq), 0 if du is None else id(du), 0 if dp is None else id(dp),
            0 if dinputs is None else id(dinputs), 0 if dt is None else id(dt), id(value), id(derivative),
        )  # fmt: skip
        return None if status else (value, derivative)

    return short


def _empty(shape: Shape) -> Array:
    """Room for results.

    Raises
    ------
    MemoryError
        Says how much was asked for.
    """
    try:
        return np.empty(shape)
    except (MemoryError, ValueError):
        size = math.prod(shape) * 8 / 2**30
        raise MemoryError(
            f"results of shape {shape} take {size:,.0f} GiB, more than there is; call with fewer states or directions at a time"
        ) from None


class NumpyTarget:
    """The NumPy module of a package."""

    name = "numpy"

    def __init__(self, folder: Path, manifest: Mapping[str, Any]):
        self.desk: Any = NO_DESK
        module = f"{manifest['name']}_numpy"
        spec = importlib.util.spec_from_file_location(module, folder / f"{module}.py")
        assert spec is not None and spec.loader is not None
        self.module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(self.module)

    def values(self, f: Function, arrays: Mapping[str, Any], batch: Shape, out: Sequence[Array] = ()) -> list[Array]:
        """See `CTarget.values`."""
        results = self._call(f, [arrays[a] for a in f.arguments])
        return _put([_full(r, batch + shape) for r, shape in zip(results, f.shapes, strict=True)], out)

    def along(
        self,
        f: Function,
        arrays: Mapping[str, Any],
        seeds: Mapping[str, Array],
        k: int,
        batch: Shape,
        out: Sequence[Array] = (),
    ) -> list[Array]:
        """See `CTarget.along`."""
        given = [seeds[s] if s in seeds else np.zeros((k, *(1,) * len(batch), n)) for s, n in f.seeds.items()]
        given = [x[..., 0] if s == "dt" else x for s, x in zip(f.seeds, given, strict=True)]
        results = self._call(f, [*(arrays[a] for a in f.arguments), *given])
        shapes = [((k,) if d else ()) + batch + s for s, d in zip(f.shapes, f.derived, strict=True)]
        return _put([_full(r, shape) for r, shape in zip(results, shapes, strict=True)], out)

    def _call(self, f: Function, arguments: list[Any]) -> Any:
        try:
            with np.errstate(all="ignore"):  # what is not finite is told by the solver, for both targets alike
                return getattr(self.module, f.name)(*arguments)
        except self.module.SingularJointError as error:
            kinds = {k.__name__: k for k in (SingularLoopError, SingularSpringError)}
            raise kinds.get(type(error).__name__, SingularJointError)(error.link) from None


SEAL = ',\n "seal": "'


def seal(text: str) -> str:
    """The text of ``model.json`` with a digest of itself as its last entry, so that a damaged one is known."""
    body = text.rstrip().removesuffix("}").rstrip()
    return f'{body}{SEAL}{hashlib.sha256(body.encode()).hexdigest()}"\n}}\n'


def read_manifest(folder: Path) -> dict[str, Any]:
    """What ``model.json`` of a package says.

    Raises
    ------
    PackageError
        There is none, it is one of something else, or it is damaged.
    """
    first = "remove what is left of it, and "  # generate writes into no folder that it does not know as its own
    try:
        text = (folder / "model.json").read_text(encoding="utf-8")
        if SEAL in text and seal(text[: text.rindex(SEAL)] + "}") == text:
            manifest: dict[str, Any] = unrolled(json.loads(text))
            return manifest
        damaged = json.loads(text)
    except (FileNotFoundError, NotADirectoryError):
        seen, first = "no model.json in it", ""
    except OSError as error:
        seen = f"its model.json cannot be read ({error.strerror or error})"
    except (ValueError, RecursionError) as error:
        seen = f"its model.json is no JSON ({error})"
    else:
        if isinstance(damaged, dict) and damaged.get("generator") == "ordernm":
            seen = "its model.json is damaged: it is not as generate wrote it"
        else:
            seen, first = "its model.json is not one that generate wrote", ""
    raise PackageError(
        f"{folder} holds no generated solver that is whole: {seen}; {first}make one with: generate MODEL.yaml -o FOLDER"
    )


def is_sealed(folder: Path) -> bool:
    """Whether there is a ``model.json`` with a seal, right or wrong."""
    try:
        return SEAL in (folder / "model.json").read_text(encoding="utf-8")
    except (OSError, ValueError):
        return False


def check_files(folder: Path, manifest: Mapping[str, Any], suffixes: tuple[str, ...]) -> None:
    """Compare files of a package with the digests in its manifest.

    Raises
    ------
    PackageError
        Names the file that is gone or changed.
    """
    for name, digest in manifest.get("digests", {}).items():
        if not name.endswith(suffixes):
            continue
        try:
            seen = "was changed" if file_digest((folder / name).read_bytes()) != digest else ""
        except FileNotFoundError:
            seen = "is missing"
        except OSError as error:
            seen = f"cannot be read ({error.strerror or error})"
        if seen:
            raise PackageError(
                f"{folder} is damaged: its {name} {seen} since it was generated; generate it again: "
                f"generate MODEL.yaml -o FOLDER"
            )


def file_digest(content: bytes) -> str:
    """Digest of a file for the manifest."""
    return hashlib.sha256(content).hexdigest()[:16]


def _put(results: list[Array], out: Sequence[Array]) -> list[Array]:
    """Results in the arrays of the caller's, if there are any."""
    for place, result in zip(out, results, strict=False):
        place[...] = result
    return list(out) or results


def _full(x: Any, shape: Shape) -> Array:
    """An array of its own of that shape; arguments without batch axes give results without them."""
    x = np.asarray(x, dtype=np.float64)
    return x if x.shape == shape else np.broadcast_to(x, shape).copy()


# ---- the solver ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Loops that share dependent coordinates with each other and with no others.

    Attributes
    ----------
    rows : list of int
        Their conditions, among those that count.
    columns : list of int
        Their coordinates, among the dependent ones.
    coordinates : list of int
        The same, among all.
    loops : set of str
    """

    rows: list[int]
    columns: list[int]
    coordinates: list[int]
    loops: set[str]


@dataclass(slots=True, eq=False, repr=False)
class Jacobians:
    """Partial derivatives of udot.

    Attributes
    ----------
    q : (..., nu, nq)
    u : (..., nu, nu)
    p : (..., nu, np)
    inputs : (..., nu, ninputs)
    t : (..., nu)
    """

    q: Array
    u: Array
    p: Array
    inputs: Array
    t: Array

    def __repr__(self) -> str:
        shapes = ", ".join(f"{n} {getattr(self, n).shape}" for n in ("q", "u", "p", "inputs", "t"))
        return f"<Jacobians of udot: {shapes}>"


JACOBIANS = ("q", "u", "p", "inputs", "t")
"""What udot is differentiated in, in the order of `Jacobians`."""


class Solver:
    """A generated solver. May be used by several threads at once.

    Parameters
    ----------
    folder : path
        The generated package.
    target : {"c", "numpy", "both"}, optional
        Which code computes; left out: what the package was generated for. With "both" the two are compared first, then
        the C computes. Without a C compiler the NumPy module serves, and a warning says so.

    Raises
    ------
    CompileError
    TargetsDifferError

    Notes
    -----
    Arguments of the methods, all in SI units and radians: coordinates ``q (..., nq)``, speeds ``u (..., nu)``, design
    parameters ``p (..., np)`` (left out: `parameters`), ``inputs (..., ninputs)`` (left out: zeros), time ``t (...)``.
    Leading axes are batch axes and broadcast by NumPy's rules. Seeds carry their k directions first:
    ``dq (k, ..., nq)``, ``du``, ``dp``, ``dinputs`` alike, ``dt (k, ...)``; one without k counts as k = 1; missing ones
    are zero. ``p``, ``inputs`` and seeds may be mappings from some names to numbers. Results are (..., n), derivatives
    (k, ..., n).

    Every method raises ValueError for a wrong shape, a number that is not finite, an unknown name and a quaternion
    shorter than 1e-6. Methods that solve for accelerations raise `SingularJointError`.
    """

    def __init__(self, folder: str | os.PathLike[str], target: str | None = None):
        self.folder = Path(folder).absolute()
        self._manifest = manifest = read_manifest(self.folder)
        self.name: str = manifest["name"]
        self.coordinate_names: tuple[str, ...] = tuple(manifest["coordinate_names"])
        self.speed_names: tuple[str, ...] = tuple(manifest["speed_names"])
        self.parameter_names: tuple[str, ...] = tuple(manifest["parameter_names"])
        self.input_names: tuple[str, ...] = tuple(manifest["input_names"])
        self.output_names: tuple[str, ...] = tuple(manifest["output_names"])
        self.closure_names: tuple[str, ...] = tuple(manifest["closure_names"])
        self.prescribed_names: tuple[str, ...] = tuple(manifest["prescribed_names"])
        self.independent_names: tuple[str, ...] = tuple(manifest.get("independent_names", self.coordinate_names))
        self.independent_speed_names: tuple[str, ...] = tuple(manifest.get("independent_speed_names", self.speed_names))
        nq, nu = len(self.coordinate_names), len(self.speed_names)
        n_p, ninputs = len(self.parameter_names), len(self.input_names)
        self.nq, self.nu, self.np, self.ninputs, self.noutputs = nq, nu, n_p, ninputs, len(self.output_names)
        self._names = {
            "q": self.coordinate_names, "u": self.speed_names, "udot": self.speed_names, "b": self.speed_names,
            "p": self.parameter_names, "inputs": self.input_names,
        }  # fmt: skip
        self._shapes: dict[str, Shape] = {
            "q": (nq,), "u": (nu,), "p": (n_p,), "inputs": (ninputs,), "t": (), "udot": (nu,), "b": (nu,),
            "qdot": (nq,), "x": (nu,), "force": (nu,), "energy": (2,), "outputs": (self.noutputs,), "M": (nu, nu),
            "J_q": (nu, nq), "J_u": (nu, nu), "J_p": (nu, n_p), "J_inputs": (nu, ninputs), "J_t": (nu,),
            "position": (len(self.closure_names),), "velocity": (len(self.closure_names),), "step": (nq,),
            "condition": (len(manifest.get("loops", ())),), "full_q": (nq,), "full_u": (nu,),
            "reaction": (6 * len(manifest["links"]),), "loop_reaction": (6 * len(manifest.get("loops", ())),),
        }  # fmt: skip
        self._functions = self._functions_of(manifest)
        self._initial = np.array(manifest["initial"]["q"], float), np.array(manifest["initial"]["u"], float)
        self._quaternions: tuple[int, ...] = tuple(manifest["quaternions"])
        self._left_out = {"p": np.array(manifest["parameters"], float), "inputs": np.zeros(ninputs)}
        self._wanted = manifest.get("target", "c") if target is None else target
        self._target = self._choose(self._wanted, manifest, self._functions)
        self._manifests: list[dict[str, Any]] = [manifest, *([manifest["second"]] if "second" in manifest else [])]
        self._made = {0: (self._functions, self._target)}
        self._making = threading.Lock()
        self._partition = 0
        self._take_redundancy(manifest)

    def _take_redundancy(self, manifest: Mapping[str, Any]) -> None:
        """Which conditions count, by how much the others may be open, and parameters that open some."""
        self._opening: list[int] = manifest.get("opening", [])
        self._desk: Any = WatchedDesk(self._target.desk) if self._opening else self._target.desk
        self._open = np.zeros(len(self.closure_names))
        self._open[manifest.get("dropped", [])] = ALLOWED * manifest.get("loop_tolerance", 0.0)
        self._kept = np.flatnonzero(self._open == 0)

    def _functions_of(self, manifest: Mapping[str, Any]) -> dict[str, Function]:
        return {name: self._function(name, entry) for name, entry in manifest["functions"].items()}

    def _function(self, name: str, entry: Mapping[str, Any]) -> Function:
        seeds = {s: math.prod(self._shapes[s[1:]]) for s in entry.get("seeds", ())}
        results = tuple(entry["results"])
        derived = tuple(bool(seeds) and r.startswith("d") for r in results)
        shapes = tuple(self._shapes[r[1:] if d else r] for r, d in zip(results, derived, strict=True))
        return Function(
            name, tuple(entry["arguments"]), seeds, results, shapes, derived, tuple(entry.get("widths", ()))
        )

    def _choose(
        self, target: str, manifest: Mapping[str, Any], functions: dict[str, Function]
    ) -> CTarget | NumpyTarget:
        if target not in ("c", "numpy", "both"):
            raise ValueError(f"target is {target!r}; allowed are 'c', 'numpy' and 'both'")
        if target == "numpy":
            check_files(self.folder, self._manifest, ("_numpy.py",))
            return NumpyTarget(self.folder, manifest)
        check_files(self.folder, self._manifest, (".c", ".h"))
        try:
            compiled = CTarget(self.folder, manifest, functions)
        except NoCompilerError as error:
            warnings.warn(
                f"{self.name}: {error}. The NumPy target (target='numpy') serves instead: same numbers, slower",
                RuntimeWarning,
                stacklevel=4,
            )
            check_files(self.folder, self._manifest, ("_numpy.py",))
            return NumpyTarget(self.folder, manifest)
        if target == "both":
            check_files(self.folder, self._manifest, ("_numpy.py",))
            self._compare(compiled, NumpyTarget(self.folder, manifest), functions)
        return compiled

    def __getstate__(self) -> tuple[str, str, int]:
        # a pool of processes sends solvers by pickle: the package is opened anew where they arrive
        return str(self.folder), self.target, self.partition

    def __setstate__(self, state: tuple[str, str, int]) -> None:
        folder, target, partition = state
        Solver.__init__(self, folder, target)
        if partition:
            self.use_partition(partition)

    def __repr__(self) -> str:
        return (
            f"<Solver {self.name}: nq={self.nq}, nu={self.nu}, np={self.np}, ninputs={self.ninputs}, "
            f"noutputs={self.noutputs}, target={self.target}>"
        )

    # -- what the model is ---------------------------------------------------------------------------------------------

    @property
    def target(self) -> str:
        """What computes: ``c`` or ``numpy``."""
        return self._target.name

    @property
    def parameters(self) -> Array:
        """Default design parameters, (np,)."""
        return self._left_out["p"].copy()

    @property
    def initial(self) -> tuple[Array, Array]:
        """The model's initial state (q, u) at the default parameters, assembled."""
        return self.initial_state()

    # -- partitions ----------------------------------------------------------------------------------------------------

    @property
    def partitions(self) -> tuple[tuple[str, ...], ...]:
        """Names of the independent coordinates of each partition that the package holds; one, or two."""
        return tuple(tuple(m.get("independent_names", self.coordinate_names)) for m in self._manifests)

    @property
    def partition(self) -> int:
        """The partition in use."""
        return self._partition

    def use_partition(self, partition: int) -> None:
        """Take other independent coordinates from now on; states keep their meaning, since q and u hold all coordinates and
        speeds.

        Not while other threads use this solver.
        """
        if isinstance(partition, bool) or not isinstance(partition, (int, np.integer)):
            raise ValueError(f"partition is {partition!r}, expected a whole number below {len(self._manifests)}")
        if not 0 <= partition < len(self._manifests):
            raise ValueError(f"partition {partition}: there are {len(self._manifests)}, counted from 0")
        manifest = self._manifests[partition]
        self._functions, self._target = self._of_partition(int(partition))
        self._partition = int(partition)
        self._take_redundancy(manifest)
        self.independent_names = tuple(manifest.get("independent_names", self.coordinate_names))
        self.independent_speed_names = tuple(manifest.get("independent_speed_names", self.speed_names))

    def _of_partition(self, partition: int) -> tuple[dict[str, Function], CTarget | NumpyTarget]:
        """Functions and target of a partition, opened when first asked for."""
        with self._making:
            if partition not in self._made:
                manifest = self._manifests[partition]
                functions = self._functions_of(manifest)
                self._made[partition] = functions, self._choose(self._wanted, manifest, functions)
            return self._made[partition]

    def condition(self, q: Numbers, p: Numbers = None) -> Array:
        """Worst condition number of the closure matrices, for each partition, (..., len(partitions)).

        One is best; infinite where a loop has lost rank. The figure is the product of the Frobenius norms of the matrix and its
        inverse, divided by its size; linear conditions are divided by the characteristic length.
        """
        arrays, batch = self._arguments({"q": q, "p": p})
        found = np.ones((*batch, len(self._manifests)))
        if not self.closure_names:
            return found
        q_all = np.broadcast_to(arrays["q"], (*batch, self.nq))
        p_all = np.broadcast_to(arrays["p"], (*batch, self.np))
        for k in range(len(self._manifests)):
            functions, target = self._of_partition(k)
            for state in np.ndindex(batch):
                given = {"q": q_all[state].copy(), "p": p_all[state].copy()}
                try:
                    (values,) = target.values(functions["conditions"], given, ())
                    found[(*state, k)] = values.max(initial=1.0)
                except SingularLoopError:
                    found[(*state, k)] = math.inf
        return found

    @property
    def operations(self) -> dict[str, Any]:
        """Additions, multiplications, divisions and functions, by function and sweep.

        ``operations["sensitivities"]["balance_in"]["per_direction"]["additions"]`` is what one more direction costs there,
        ``"per_call"`` what all directions share. ``"start"`` computes constants, sines and cosines. A sweep that a function
        runs twice counts twice; each column of a matrix is a direction; ``"solve_in_1"`` is a sweep over directions that
        runs for values.
        """
        by_sweep = self._manifest["operations"]
        run = {name: f.get("sweeps", ()) for name, f in self._manifest["functions"].items()}
        return {name: {s: _times(by_sweep[s], sweeps.count(s)) for s in sweeps} for name, sweeps in run.items()}

    # -- arguments -----------------------------------------------------------------------------------------------------

    def _argument(self, name: str, value: Any, of: str, rest: Array | float = 0.0) -> Array:
        """An array of finite numbers whose last axis is that of the names of `of`; anything else is an error.

        `rest` is what a mapping leaves out.
        """
        n = self._shapes[of]
        if type(value) is not np.ndarray or value.dtype != np.float64:
            value = self._named(name, value, of, rest) if isinstance(value, Mapping) else _numbers(name, value)
        if not value.flags.aligned:  # the C reads doubles where doubles may be
            value = value.copy()
        if value.ndim > MOST_AXES + (1 if name == of else 2):
            raise ValueError(
                f"{name} has {value.ndim} axes, expected at most {MOST_AXES} of a batch; reshape it into fewer, such as by "
                f"reshape(-1, n)"
            )
        if n:
            if value.ndim == 0 or value.shape[-1] != n[0]:
                shape = f"(k, ..., {n[0]})" if name != of else f"(..., {n[0]})"
                raise ValueError(
                    f"{name} has shape {value.shape}, expected {shape}: one number for each of {_some(self._names[of])}"
                )
            if value.ndim == 1:
                if not value.flags.c_contiguous:
                    value = np.ascontiguousarray(value)
                if _is_finite(value):
                    return value
        if not np.isfinite(_once(value)).all():
            place = tuple(int(i) for i in np.argwhere(~np.isfinite(value))[0])
            where = f"[{', '.join(map(str, place))}]" if place else ""
            which = f" ({self._names[of][place[-1]]})" if n else ""
            raise ValueError(f"{name}{where}{which} is {value[place]}, expected finite numbers")
        return value

    def _named(self, name: str, given: Mapping[str, Any], of: str, rest: Array | float) -> Array:
        """An array from some of its entries; the others are those of `rest`."""
        if of not in self._names:
            raise ValueError(f"{name} is a mapping, expected numbers of shape (...)")
        names = self._names[of]
        unknown = [n for n in given if n not in names]
        if unknown:
            near = difflib.get_close_matches(str(unknown[0]), names, 1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise ValueError(f"{name}: {unknown[0]!r} is not known; expected is any of {_some(names)}{hint}")
        columns = {n: _numbers(f"{name}[{n!r}]", x) for n, x in given.items()}
        try:
            lead = np.broadcast_shapes(np.shape(rest)[:-1], *(x.shape for x in columns.values()))
        except ValueError:
            shapes = ", ".join(f"{n} {x.shape}" for n, x in columns.items())
            raise ValueError(f"{name}: shapes do not broadcast: {shapes}") from None
        result = np.empty((*lead, len(names)))
        result[...] = rest
        for n, x in columns.items():
            result[..., names.index(n)] = x
        return result

    def _arguments(self, given: Mapping[str, Any]) -> tuple[dict[str, Any], Shape]:
        """Checked arguments, and the shape of the batch they make together."""
        arrays: dict[str, Any] = {}
        batch: Shape = ()
        for name, value in given.items():
            if value is None and name in self._left_out:
                arrays[name] = self._left_out[name]
                continue
            if name == "t":
                if type(value) is float and math.isfinite(value):
                    arrays[name] = value
                    continue
                value = self._argument(name, value, name)
                arrays[name] = value if value.ndim else float(value)
                lead = value.shape
            else:
                rest = self._rest(name, given) if isinstance(value, Mapping) else 0.0
                arrays[name] = value = self._argument(name, value, name, rest)
                lead = value.shape[:-1]
            if lead != batch:
                batch = _broadcast(batch, lead, lambda: arrays)
        if self._quaternions and "q" in arrays:
            self._check_quaternions(arrays["q"])
        return arrays, batch

    def _rest(self, name: str, given: Mapping[str, Any]) -> Array | float:
        """What a mapping leaves out: the initial state at the given parameters, default parameters, else zeros."""
        if name not in ("q", "u"):
            return self._left_out.get(name, 0.0)
        p = given.get("p")
        if p is not None and self.closure_names:
            # what the mapping says may close where the initial independent coordinates do not
            with contextlib.suppress(SingularLoopError, AssemblyError):
                return self.initial_state(p)[name == "u"]
        return self._initial_values(p)[name == "u"]

    def _check_quaternions(self, q: Array) -> None:
        q = _once(q)
        for i in self._quaternions:
            e = q[..., i : i + 4]
            with np.errstate(all="ignore"):  # of entries beyond 1e154
                square = e.dot(e) if e.ndim == 1 else np.einsum("...i,...i", e, e).min(initial=math.inf)
            if square < SMALLEST_QUATERNION**2:
                names = ", ".join(self.coordinate_names[i : i + 4])
                raise ValueError(
                    f"q: the quaternion ({names}) has length {math.sqrt(square):.3g}, expected at least "
                    f"{SMALLEST_QUATERNION:g}; no rotation is (1, 0, 0, 0)"
                )

    def _directions(
        self, given: Mapping[str, Any], arrays: Mapping[str, Any], batch: Shape
    ) -> tuple[dict[str, Array], int, Shape]:
        """Checked seeds (k, ..., n) with as many batch axes as the batch; k; the batch with theirs."""
        seeds: dict[str, Array] = {}
        for name, value in given.items():
            if value is None:
                continue
            of = name[1:]
            seed = self._argument(name, value, of)
            if of == "t":
                seed = seed[..., None]
            seeds[name] = seed[None] if seed.ndim == 1 else seed
        if not seeds:
            raise ValueError(
                f"no seed given; give at least one of {', '.join(given)}, directions first: dq (k, ..., nq)"
            )
        counts = {name: len(seed) for name, seed in seeds.items()}
        k = next(iter(counts.values()))
        if any(c != k for c in counts.values()):
            seen = ", ".join(f"{name} {c}" for name, c in counts.items())
            raise ValueError(
                f"the seeds have different numbers of directions: {seen}; the first axis of all counts the same ones"
            )
        for seed in seeds.values():
            if seed.shape[1:-1] != batch:
                batch = _broadcast(batch, seed.shape[1:-1], lambda: {**arrays, **seeds})
        for name, seed in seeds.items():
            missing = len(batch) - (seed.ndim - 2)
            if missing:
                seeds[name] = seed.reshape(k, *(1,) * missing, *seed.shape[1:])
        return seeds, k, batch

    def _find(self, name: str) -> Function:
        f = self._functions.get(name)
        if f is None and name == "reactions":
            raise AttributeError(f"{self.name} was generated without reactions: generate it with --reactions")
        if f is None and self.closure_names:
            raise AttributeError(f"{self.name} has closed loops: {name!r} is defined for trees only")
        if f is None:
            raise AttributeError(
                f"{self.name} was generated without the function {name!r}; it has {', '.join(self._functions)}"
            )
        return f

    def _values(self, name: str, given: Mapping[str, Any], out: Any = None) -> list[Array]:
        f = self._find(name)
        arrays, batch = self._arguments(given)
        places: list[Array] = []
        if out is not None:
            places = _places([out], list(f.results), [batch + s for s in f.shapes])
        if name in SHORT and not batch and not places:
            # what came as lists, by name or of another type is plain now
            found = getattr(self._desk, name)(*(arrays[n] for n in STATE))
            if found is not None:
                return [found]
        if not _overlap(places, arrays):
            results = self._target.values(f, arrays, batch, places)
        else:
            results = _put(self._target.values(f, arrays, batch), places)
        self._tell_infinite(f, results, arrays, batch)
        return results

    def _along(self, name: str, given: Mapping[str, Any], seeds: Mapping[str, Any], out: Any = None) -> Any:
        f = self._find(name)
        if self._opening and seeds.get("dp") is not None and "q" in given and name != "closure_sensitivities":
            self._warn_of_opening(given, seeds["dp"])
        arrays, batch = self._arguments(given)
        directions, k, batch = self._directions(seeds, arrays, batch)
        places: list[Array] = []
        if out is not None:
            shapes = [((k,) if d else ()) + batch + s for s, d in zip(f.shapes, f.derived, strict=True)]
            places = _places(out, list(f.results), shapes)
        if name in SHORT and not batch and not places:
            plain = [directions.get(s) for s in ("dq", "du", "dp", "dinputs")]
            dt = directions["dt"][..., 0] if "dt" in directions else None
            found = getattr(self._desk, name)(*(arrays[n] for n in STATE), (*plain, dt))
            if found is not None:
                return found
        if not _overlap(places, {**arrays, **directions}):
            results = self._target.along(f, arrays, directions, k, batch, places)
        else:
            results = _put(self._target.along(f, arrays, directions, k, batch), places)
        self._tell_infinite(f, results, arrays, batch, directions, k)
        return tuple(results)

    def _tell_infinite(
        self,
        f: Function,
        results: Sequence[Array],
        arrays: Mapping[str, Any],
        batch: Shape,
        seeds: Mapping[str, Array] | None = None,
        k: int = 0,
    ) -> None:
        """Warn of results that are not finite, with what made them so."""
        for name, x, derived in zip(f.results, results, f.derived, strict=True):
            if _all_finite(x):
                continue
            state = np.argwhere(~np.isfinite(x))[0][derived : derived + len(batch)]
            at = tuple(int(i) for i in state)
            alone = {
                n: _of_state(a, batch, at, 0) if n != "t" else float(np.broadcast_to(a, batch)[at])
                for n, a in arrays.items()
            }
            along = {s: _of_state(a, batch, at, 1) for s, a in (seeds or {}).items()}
            reason = ""
            if "outputs" in (name, name[1:]):
                bad = sorted({int(i) for i in np.argwhere(~np.isfinite(x))[:, -1]})
                reason = f": {_some([self.output_names[i] for i in bad])}"
            elif {"q", "u"} <= set(arrays):
                reason = self._inquire(f.name, alone, along, k)
            where = f" in state {list(at)} of the batch" if batch else ""
            warnings.warn(
                f"{self.name}: {name} of {f.name} is not finite{where}{reason}",
                RuntimeWarning,
                stacklevel=_level_of_caller(),
            )
            return

    def _units(self) -> tuple[dict[str, Array], int]:
        """Seeds of all columns of the Jacobians."""
        sizes = self._functions["sensitivities"].seeds
        every = np.eye(sum(sizes.values()))
        ends = itertools.accumulate(sizes.values())
        return {s: every[:, end - n : end] for (s, n), end in zip(sizes.items(), ends, strict=True)}, len(every)

    def _inquire(self, name: str, arrays: Mapping[str, Any], seeds: Mapping[str, Array], k: int) -> str:
        """What makes the results of one state infinite: the NumPy module does the forward dynamics again, sweep by sweep."""
        module = NumpyTarget(self.folder, self._manifests[self._partition]).module
        f = self._functions["accelerations"]
        given = {n: arrays[n] for n in f.arguments}
        wanted = self._functions["sensitivities"].seeds
        for s, n in wanted.items() if seeds else ():
            given[s] = seeds[s] if s in seeds else np.zeros((k, n))
            given[s] = given[s][..., 0] if s == "dt" else given[s]
        with np.errstate(all="ignore"), contextlib.suppress(Exception):
            a = module.Call(**given)
            module.start(a)
            return self._first_infinite(module, a, moved=not name.startswith("energ"), along=bool(seeds))
        return ""

    def _first_infinite(self, module: Any, a: Any, moved: bool, along: bool) -> str:
        """The first force, spring or body whose numbers are not finite, in words."""

        def bad(values: Any) -> list[int]:
            return [i for i, x in enumerate(values) if not np.isfinite(x).all()]

        def force(i: int, what: str) -> str:
            joint = self.speed_names[i].partition(".")[0]
            lines = [line.strip() for line in self._manifest.get("description", ())]
            told = [line for line in lines if line.startswith("force ") and f"on joint {joint}:" in line]
            return f": {what} on joint {joint} is not ({'; '.join(told) or self.speed_names[i]})"

        def spring(i: int, what: str) -> str:
            return f": {what} of spring {self._manifest['springs'][i // 3]} are not"

        if hasattr(module, "joint_forces"):
            module.joint_forces(a)
        for i in bad(getattr(a, "tau", ())) if moved else ():
            return force(i, "the force")
        if hasattr(module, "spring_forces"):
            module.spring_forces(a)
        for i in bad(getattr(a, "coefficient", ())):
            return spring(i, "the coefficients")
        names = self._manifest["links"]
        links = a.records[: len(names)]
        for i in bad([_sum_of_sizes(x for n, x in r.items() if n.startswith("ext.")) for r in links]):
            return (
                f": the force of springs on body {names[i].partition('.')[0]} is too large for floating-point numbers"
            )
        module.kinematics(a)
        for i in bad([_sum_of_sizes(r.values()) for r in links]):
            return f": the motion of body {names[i].partition('.')[0]} is too large for floating-point numbers"
        module.forward(a)
        for i in bad(a.udot):
            joint = self.speed_names[i].partition(".")[0]
            return f": the acceleration of joint {joint} is too large for floating-point numbers"
        if along and hasattr(module, "joint_force_tangents"):
            module.joint_force_tangents(a)
            for i in bad(getattr(a, "dtau", ())):
                return force(i, "the derivative of the force")
        if along and hasattr(module, "spring_force_tangents"):
            with contextlib.suppress(Exception):
                module.spring_force_tangents(a)
            for i in bad(getattr(a, "dcoefficient", ())):
                return spring(i, "the derivatives of the coefficients")
        return ""

    # -- dynamics ------------------------------------------------------------------------------------------------------

    def accelerations(
        self,
        q: Numbers,
        u: Numbers,
        p: Numbers = None,
        inputs: Numbers = None,
        t: ArrayLike = 0.0,
        *,
        out: Array | None = None,
    ) -> Array:
        """The derivatives of the speeds, udot (..., nu), by Eqs. 18-24 and 42-56."""
        found: Array | None = self._desk.accelerations(q, u, p, inputs, t, out)
        if found is None:
            return self._values("accelerations", {"q": q, "u": u, "p": p, "inputs": inputs, "t": t}, out)[0]
        return found

    def sensitivities(
        self,
        q: Numbers,
        u: Numbers,
        p: Numbers = None,
        inputs: Numbers = None,
        t: ArrayLike = 0.0,
        *,
        dq: Numbers = None,
        du: Numbers = None,
        dp: Numbers = None,
        dinputs: Numbers = None,
        dt: ArrayLike | None = None,
        out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:
        """udot (..., nu) and its total derivative (k, ..., nu) along the seeds (Eqs. 9, 10), exact to rounding."""
        found: tuple[Array, Array] | None = self._desk.sensitivities(q, u, p, inputs, t, (dq, du, dp, dinputs, dt), out)
        return found or self._state_along("sensitivities", q, u, p, inputs, t, dq, du, dp, dinputs, dt, out)

    def jacobians(
        self,
        q: Numbers,
        u: Numbers,
        p: Numbers = None,
        inputs: Numbers = None,
        t: ArrayLike = 0.0,
        *,
        out: Jacobians | None = None,
    ) -> Jacobians:
        """Every partial derivative of udot."""
        quick: Jacobians | None = self._desk.jacobians(q, u, p, inputs, t, out)
        if quick is not None:
            return quick
        f = self._find("jacobians")
        arrays, batch = self._arguments({"q": q, "u": u, "p": p, "inputs": inputs, "t": t})
        if self._opening:
            self._warn_of_opening({"q": q, "u": u, "p": p}, np.eye(self.np))
        shapes = {n: batch + self._shapes[f"J_{n}"] for n in JACOBIANS}
        if out is None:
            J = Jacobians(*(_empty(shapes[n]) for n in JACOBIANS))
        elif isinstance(out, Jacobians):
            J = out
        else:
            raise ValueError(f"out is {type(out).__name__}, expected Jacobians, such as those of an earlier call")
        places = _places([getattr(J, n) for n in JACOBIANS], [f"J.{n}" for n in JACOBIANS], list(shapes.values()))
        named = dict(zip((f"J_{n}" for n in JACOBIANS), places, strict=True))
        wanted = [named[r] if r in named else _empty(batch + s) for r, s in zip(f.results, f.shapes, strict=True)]
        if out is not None and _overlap(places, arrays):
            _put(self._target.values(f, arrays, batch), wanted)
        else:
            self._target.values(f, arrays, batch, wanted)
        if not all(map(_all_finite, wanted)):
            units, k = self._units()
            self._tell_infinite(f, wanted, arrays, batch, units, k)
        for name, place in named.items():
            if name not in f.results:
                place[...] = 0.0
        return J

    def coordinate_rates(
        self,
        q: Numbers,
        u: Numbers,
        p: Numbers = None,
        inputs: Numbers = None,
        t: ArrayLike = 0.0,
        *,
        out: Array | None = None,
    ) -> Array:
        """The derivatives of the coordinates, qdot (..., nq), by Eq. 1."""
        found: Array | None = self._desk.coordinate_rates(q, u, p, inputs, t, out)
        if found is None:
            return self._values("coordinate_rates", {"q": q, "u": u, "p": p, "inputs": inputs, "t": t}, out)[0]
        return found

    def coordinate_rate_sensitivities(
        self,
        q: Numbers,
        u: Numbers,
        p: Numbers = None,
        inputs: Numbers = None,
        t: ArrayLike = 0.0,
        *,
        dq: Numbers = None,
        du: Numbers = None,
        dp: Numbers = None,
        dinputs: Numbers = None,
        dt: ArrayLike | None = None,
        out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:
        """qdot (..., nq) and its total derivative (k, ..., nq) along the seeds."""
        found: tuple[Array, Array] | None = self._desk.coordinate_rate_sensitivities(
            q, u, p, inputs, t, (dq, du, dp, dinputs, dt), out
        )
        return found or self._state_along(
            "coordinate_rate_sensitivities", q, u, p, inputs, t, dq, du, dp, dinputs, dt, out
        )

    def _state_along(
        self, name: str, q: Any, u: Any, p: Any, inputs: Any, t: Any, dq: Any, du: Any, dp: Any, dinputs: Any, dt: Any,
        out: Any = None,
    ) -> Any:  # fmt: skip
        """The long way of a function of the state over directions."""
        given = {"q": q, "u": u, "p": p, "inputs": inputs, "t": t}
        return self._along(name, given, {"dq": dq, "du": du, "dp": dp, "dinputs": dinputs, "dt": dt}, out)

    def mass_matrix(self, q: Numbers, p: Numbers = None, *, out: Array | None = None) -> Array:
        """The mass matrix M of Eq. 4, (..., nu, nu)."""
        return self._values("mass_matrix", {"q": q, "p": p}, out)[0]

    def mass_matrix_sensitivities(
        self,
        q: Numbers,
        p: Numbers = None,
        *,
        dq: Numbers = None,
        dp: Numbers = None,
        out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:
        """M (..., nu, nu) and its total derivative (k, ..., nu, nu) along the seeds."""
        return self._along("mass_matrix_sensitivities", {"q": q, "p": p}, {"dq": dq, "dp": dp}, out)

    def solve_mass(self, q: Numbers, b: Numbers, p: Numbers = None, *, out: Array | None = None) -> Array:
        """The solution x (..., nu) of M x = b for generalised forces b (..., nu), in O(n)."""
        return self._values("solve_mass", {"q": q, "b": b, "p": p}, out)[0]

    def solve_mass_sensitivities(
        self,
        q: Numbers,
        b: Numbers,
        p: Numbers = None,
        *,
        dq: Numbers = None,
        db: Numbers = None,
        dp: Numbers = None,
        out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:
        """x (..., nu) of M x = b and its total derivative (k, ..., nu) along the seeds; ``db (k, ..., nu)``."""
        given, seeds = {"q": q, "b": b, "p": p}, {"dq": dq, "db": db, "dp": dp}
        found: tuple[Array, Array] = self._along("solve_mass_sensitivities", given, seeds, out)
        return found

    def inverse_dynamics(
        self,
        q: Numbers,
        u: Numbers,
        udot: Numbers,
        p: Numbers = None,
        inputs: Numbers = None,
        t: ArrayLike = 0.0,
        *,
        out: Array | None = None,
    ) -> Array:
        """The joint forces (..., nu) that udot (..., nu) needs beside the model's own: M udot - K."""
        given = {"q": q, "u": u, "udot": udot, "p": p, "inputs": inputs, "t": t}
        return self._values("inverse_dynamics", given, out)[0]

    def inverse_dynamics_sensitivities(
        self,
        q: Numbers,
        u: Numbers,
        udot: Numbers,
        p: Numbers = None,
        inputs: Numbers = None,
        t: ArrayLike = 0.0,
        *,
        dq: Numbers = None,
        du: Numbers = None,
        dudot: Numbers = None,
        dp: Numbers = None,
        dinputs: Numbers = None,
        dt: ArrayLike | None = None,
        out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:
        """The joint forces of `inverse_dynamics` and their total derivative (k, ..., nu); ``dudot (k, ..., nu)``."""
        given = {"q": q, "u": u, "udot": udot, "p": p, "inputs": inputs, "t": t}
        seeds = {"dq": dq, "du": du, "dudot": dudot, "dp": dp, "dinputs": dinputs, "dt": dt}
        return self._along("inverse_dynamics_sensitivities", given, seeds, out)

    def bias_force(
        self,
        q: Numbers,
        u: Numbers,
        p: Numbers = None,
        inputs: Numbers = None,
        t: ArrayLike = 0.0,
        *,
        out: Array | None = None,
    ) -> Array:
        """The joint forces (..., nu) that hold udot at zero, -K of Eq. 4: M udot + bias_force = 0."""
        return self.inverse_dynamics(q, u, np.zeros(self.nu), p, inputs, t, out=out)

    def bias_force_sensitivities(
        self,
        q: Numbers,
        u: Numbers,
        p: Numbers = None,
        inputs: Numbers = None,
        t: ArrayLike = 0.0,
        *,
        dq: Numbers = None,
        du: Numbers = None,
        dp: Numbers = None,
        dinputs: Numbers = None,
        dt: ArrayLike | None = None,
        out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:
        """The forces of `bias_force` and their total derivative (k, ..., nu) along the seeds."""
        given = {"q": q, "u": u, "udot": np.zeros(self.nu), "p": p, "inputs": inputs, "t": t}
        seeds = {"dq": dq, "du": du, "dp": dp, "dinputs": dinputs, "dt": dt}
        return self._along("inverse_dynamics_sensitivities", given, seeds, out)

    def energies(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: ArrayLike = 0.0
    ) -> tuple[Array, Array]:
        """Kinetic and potential energy, (...) each, J; gravity's is zero at the ground's origin."""
        energy: Array | None = self._desk.energies(q, u, p, inputs, t)
        if energy is None:
            (energy,) = self._values("energies", {"q": q, "u": u, "p": p, "inputs": inputs, "t": t})
        return energy[..., 0], energy[..., 1]

    def energy_sensitivities(
        self,
        q: Numbers,
        u: Numbers,
        p: Numbers = None,
        inputs: Numbers = None,
        t: ArrayLike = 0.0,
        *,
        dq: Numbers = None,
        du: Numbers = None,
        dp: Numbers = None,
        dinputs: Numbers = None,
        dt: ArrayLike | None = None,
    ) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Kinetic and potential energy, and their total derivatives: (T, V), (dT, dV), dT and dV (k, ...)."""
        energy, denergy = self._desk.energy_sensitivities(
            q, u, p, inputs, t, (dq, du, dp, dinputs, dt)
        ) or self._state_along("energy_sensitivities", q, u, p, inputs, t, dq, du, dp, dinputs, dt)
        return (energy[..., 0], energy[..., 1]), (denergy[..., 0], denergy[..., 1])

    def outputs(
        self,
        q: Numbers,
        u: Numbers,
        p: Numbers = None,
        inputs: Numbers = None,
        t: ArrayLike = 0.0,
        *,
        out: Array | None = None,
    ) -> Array:
        """The model's outputs (..., noutputs), in the order of `output_names`."""
        found: Array | None = self._desk.outputs(q, u, p, inputs, t, out)
        if found is not None:
            return found
        given = {"q": q, "u": u, "p": p, "inputs": inputs, "t": t}
        if not self.noutputs:
            shape = (*self._arguments(given)[1], 0)
            return np.zeros(shape) if out is None else _places([out], ["outputs"], [shape])[0]
        return self._values("outputs", given, out)[0]

    def output_sensitivities(
        self,
        q: Numbers,
        u: Numbers,
        p: Numbers = None,
        inputs: Numbers = None,
        t: ArrayLike = 0.0,
        *,
        dq: Numbers = None,
        du: Numbers = None,
        dp: Numbers = None,
        dinputs: Numbers = None,
        dt: ArrayLike | None = None,
        out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:
        """The model's outputs (..., noutputs) and their total derivative (k, ..., noutputs) along the seeds."""
        if not self.noutputs:
            given = {"q": q, "u": u, "p": p, "inputs": inputs, "t": t}
            seeds = {"dq": dq, "du": du, "dp": dp, "dinputs": dinputs, "dt": dt}
            _, k, batch = self._directions(seeds, *self._arguments(given))
            return np.zeros((*batch, 0)), np.zeros((k, *batch, 0))
        found: tuple[Array, Array] | None = self._desk.output_sensitivities(
            q, u, p, inputs, t, (dq, du, dp, dinputs, dt), out
        )
        return found or self._state_along("output_sensitivities", q, u, p, inputs, t, dq, du, dp, dinputs, dt, out)

    def reactions(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: ArrayLike = 0.0
    ) -> tuple[Array, Array]:
        """What joints and loops transmit, in the ground frame: moment, N m, then force, N.

        Needs a package that was generated with reactions.

        Returns
        -------
        joints : (..., nbodies, 6)
            What the joint of each body does to it, about the body's origin, the joint's own force included. NaN for a body on a
            fixed joint: it is one with what carries it.
        loops : (..., nloops, 6)
            What each loop joint does to its ``to`` body, about the origin of the face there. Where conditions are redundant
            they are not unique: these are, ear by ear, the ones with the least sum of squares of moments, and forces
            times the characteristic length.
        """
        found = self._values("reactions", {"q": q, "u": u, "p": p, "inputs": inputs, "t": t})
        batch = found[0].shape[:-1]
        links, *loops = (x.reshape(*batch, x.shape[-1] // 6, 6) for x in found)
        of_bodies: list[int] = self._manifest["joint_links"]
        joints = np.full((*batch, len(of_bodies), 6), math.nan)
        for body, link in enumerate(of_bodies):
            if link >= 0:
                joints[..., body, :] = links[..., link, :]
        return joints, loops[0] if loops else np.zeros((*batch, 0, 6))

    # -- states --------------------------------------------------------------------------------------------------------

    def assemble(
        self, q: Numbers = None, u: Numbers = None, p: Numbers = None, inputs: Numbers = None, t: ArrayLike = 0.0
    ) -> tuple[Array, Array]:
        """A consistent state (q, u): loops closed, quaternions of unit length.

        Parameters
        ----------
        q, u : (..., nq) and (..., nu), optional
            The guess; its independent entries are kept, dependent ones are changed. What is left out is the model's initial
            state.

        Raises
        ------
        AssemblyError
            Names the loop and what is left of its conditions.
        """
        if q is None or u is None:
            first = self._initial_values(p)
            q, u = first[0] if q is None else q, first[1] if u is None else u
        arrays, batch = self._arguments({"q": q, "u": u, "p": p, "inputs": inputs, "t": t})
        q_new = self._assembled(arrays, batch)
        if self.closure_names:
            return q_new, self._values("completion", {**arrays, "q": q_new})[0]
        return q_new, np.broadcast_to(arrays["u"], (*batch, self.nu)).copy()

    def initial_state(self, p: Numbers = None) -> tuple[Array, Array]:
        """The model's initial state (q, u) at some parameters, assembled: initial values may be expressions of them."""
        return self.assemble(p=p)

    def initial_sensitivities(self, p: Numbers = None, *, dp: Numbers) -> tuple[Array, Array, Array, Array]:
        """The state of `initial_state` and its derivatives: q, u, dq (k, ..., nq), du (k, ..., nu).

        Where initial values depend on parameters, theirs are part of it, and loops stay closed.
        """
        q, u = self._initial_values(p)
        if "initial_sensitivities" not in self._functions:
            return self.assemble_sensitivities(q, u, p, dp=dp)
        _, _, dq, du = self._along("initial_sensitivities", {"p": p}, {"dp": dp})
        return self.assemble_sensitivities(q, u, p, dq=dq, du=du, dp=dp)

    def _initial_values(self, p: Numbers) -> tuple[Array, Array]:
        """The initial values at some parameters, as a guess for assembly.

        Where the model's values do not close its loops, the package has assembled ones at the default parameters; they move
        with the parameters as the model's do.
        """
        if p is None or "initial" not in self._functions:
            return self._initial
        found = self._values("initial", {"p": p})
        default = self._values("initial", {"p": self._left_out["p"]})
        q, u = (
            np.where(known == d, x, known + (x - d)) for x, d, known in zip(found, default, self._initial, strict=True)
        )
        return q, u

    def _assembled(self, arrays: Mapping[str, Any], batch: Shape) -> Array:
        """Assembled coordinates, (..., nq)."""
        q_new = np.broadcast_to(arrays["q"], (*batch, self.nq)).copy()
        self._normalise(q_new)
        if self.closure_names:
            given = {"q": q_new, "u": np.zeros(self.nu), "p": arrays["p"]}
            gaps = np.abs(self._target.values(self._functions["closure"], given, batch)[0][..., self._kept]).max(
                axis=-1
            )
            p = np.broadcast_to(arrays["p"], (*batch, self.np))
            for state in zip(*np.nonzero(np.atleast_1d(~(gaps <= ROUNDING))), strict=True):
                state = tuple(int(i) for i in state[: len(batch)])
                q_new[state] = self._close(q_new[state].copy(), p[state].copy(), state)
        return q_new

    def _normalise(self, q: Array) -> None:
        for i in self._quaternions:
            e = q[..., i : i + 4]
            e /= np.abs(e).max(axis=-1, keepdims=True)
            e /= _length(e)

    def _close(self, q: Array, p: Array, state: tuple[int, ...]) -> Array:
        """Close the loops of one state; where the guess does not lead there, from others."""
        dependent = [i for i, name in enumerate(self.coordinate_names) if name not in self.independent_names]
        try:
            return self._newton(q, p, state)
        except AssemblyError:
            found = self._from_elsewhere(q, p, dependent)
            if found is None:
                raise
            return self._newton(found, p, state)
        except SingularLoopError as singular:
            # no two of the numbers are the same, nor opposite: no symmetry that the guess may have is kept
            direction = np.sin(1.0 + np.arange(len(dependent)))
            for size in STEPS_OFF:
                trial = q.copy()
                trial[dependent] += size * direction
                self._normalise(trial)
                with contextlib.suppress(SingularLoopError, AssemblyError):
                    return self._newton(trial, p, state)
            found = self._from_elsewhere(q, p, dependent)
            if found is None:
                raise singular
            return self._newton(found, p, state)

    def _from_elsewhere(self, q: Array, p: Array, dependent: list[int]) -> Array | None:
        """A closed state with the independent coordinates of a guess that leads to none; or None where none is found.

        Loops that share no dependent coordinates are closed apart: one that does not close holds up no other.
        """
        if len(dependent) > SEVERAL:
            return None
        parts = self._parts(q, p, dependent)
        rng = np.random.default_rng(0)  # the same guess leads to the same state
        left, closed = list(parts), q.copy()
        for n in range(GUESSES + 1):
            trial = closed.copy()
            for part in left:
                off = FURTHEST * n / GUESSES * rng.uniform(-1.0, 1.0, len(part.coordinates))
                trial[part.coordinates] = q[part.coordinates] + off
            self._normalise(trial)
            trial, sizes = self._newton_apart(trial, p, left, rng)
            for part, size in zip(left, sizes, strict=True):
                if size <= CLOSED:
                    closed[part.coordinates] = trial[part.coordinates]
            left = [part for part, size in zip(left, sizes, strict=True) if not size <= CLOSED]
            if not left:
                return closed
        return None

    def _gaps(self, q: Array, p: Array) -> Array:
        """Conditions that count, (..., of them)."""
        still = np.zeros(self.nu)
        found: Array = self._target.values(self._functions["closure"], {"q": q, "u": still, "p": p}, q.shape[:-1])[0]
        return found[..., self._kept]

    def _parts(self, q: Array, p: Array, dependent: list[int]) -> list[Part]:
        """Loops in sets that share no dependent coordinates, as is seen from what each coordinate changes."""
        n = len(dependent)
        moved = np.tile(q, (n + 1, 1))
        moved[:, dependent] += 0.1 * np.sin(1.0 + np.arange(n))  # off guesses that are special
        moved[1:, dependent] += 0.3 * np.eye(n)
        self._normalise(moved)
        gaps = self._gaps(moved, np.tile(p, (n + 1, 1)))
        concerned = np.abs(gaps[1:] - gaps[0]) > 1e-9 * (1.0 + np.abs(gaps[0]))
        of_loop = [self.closure_names[k].rpartition(".")[0] for k in self._kept]
        parts: list[Part] = []
        for name in dict.fromkeys(of_loop):
            rows = {k for k, loop in enumerate(of_loop) if loop == name}
            columns = {int(i) for i in np.flatnonzero(concerned[:, sorted(rows)].any(axis=1))}
            for i in self._quaternions:  # as a whole
                whole = {k for k, c in enumerate(dependent) if i <= c < i + 4}
                columns |= whole if columns & whole else set()
            for other in [part for part in parts if columns.intersection(part.columns)]:
                parts.remove(other)
                rows, columns = rows | {*other.rows}, columns | {*other.columns}
            at = sorted(columns)
            parts.append(Part(sorted(rows), at, [dependent[i] for i in at], {of_loop[k] for k in rows}))
        return parts

    def _newton_apart(
        self, q: Array, p: Array, parts: list[Part], rng: np.random.Generator
    ) -> tuple[Array, list[float]]:
        """Newton's method with a line search for each of some parts, and the largest residual of each."""

        def size(gaps: Array, part: Part) -> float:
            with np.errstate(all="ignore"):  # a step may lead anywhere
                return float(np.linalg.norm(gaps[part.rows]))

        gaps = self._gaps(q, p)
        going = list(parts)
        for _ in range(NEWTON_STEPS):
            going = [part for part in going if np.abs(gaps[part.rows]).max() > CLOSED]
            if not going:
                break
            try:
                (step,) = self._target.values(self._functions["newton_step"], {"q": q, "p": p}, ())
            except SingularLoopError as singular:
                flat = [part for part in going if singular.link in part.loops]
                if not flat:  # one that is closed: no steps are known for the others
                    break
                for part in flat:
                    q[part.coordinates] += rng.uniform(-0.1, 0.1, len(part.coordinates))
                self._normalise(q)
                gaps = self._gaps(q, p)
                continue
            searching, going = going, []
            for fraction in SEARCH:
                trial = q.copy()
                for part in searching:
                    trial[part.coordinates] += fraction * step[part.coordinates]
                self._normalise(trial)
                after = self._gaps(trial, p)
                better = [part for part in searching if size(after, part) < (1.0 - 0.1 * fraction) * size(gaps, part)]
                for part in better:
                    q[part.coordinates] = trial[part.coordinates]
                going += better
                searching = [part for part in searching if part not in better]
                if not searching:
                    break
            gaps = self._gaps(q, p)
        return q, [float(np.abs(gaps[part.rows]).max(initial=0.0)) for part in parts]

    def _newton(self, q: Array, p: Array, state: tuple[int, ...]) -> Array:
        """Newton's method on the dependent coordinates of one state, with a line search."""
        still = np.zeros(self.nu)

        def square(x: Array) -> float:
            with np.errstate(all="ignore"):  # a step may lead anywhere
                return float(x @ x)

        def gaps(q: Array) -> Array:
            return self._target.values(self._functions["closure"], {"q": q, "u": still, "p": p}, ())[0]

        found = gaps(q)[self._kept]
        for _ in range(NEWTON_STEPS):
            size = float(np.abs(found).max())
            if not size > 0.0:
                break
            (step,) = self._target.values(self._functions["newton_step"], {"q": q, "p": p}, ())
            better = False
            for part in SEARCH:
                trial = q + part * step
                self._normalise(trial)
                after = gaps(trial)[self._kept]
                # the sum of squares goes down by nearly what a linear closure would take off
                if square(after) < (1.0 - 0.2 * part) * square(found):
                    q, found, better = trial, after, True
                    break
            if not better:
                break
        size = float(np.abs(found).max(initial=0.0))
        where = f" (state {list(state)} of the batch)" if state else ""
        if not size <= CLOSED:
            worst = self.closure_names[self._kept[int(np.argmax(np.abs(found)))]].rpartition(".")[0]
            raise AssemblyError(worst, size, where)
        if len(self._kept) < len(self.closure_names):
            self._warn_of_gaps(gaps(q), where)
        return q

    def _warn_of_gaps(self, gaps: Array, where: str) -> None:
        """Conditions that were dropped since they follow from others nearly, and that are open by more than that."""
        excess = np.where(self._open > 0, np.abs(gaps) - self._open, 0.0)
        worst = int(np.argmax(excess))
        if excess[worst] > 0:
            warnings.warn(
                f"condition {self.closure_names[worst]}, which was dropped since it follows from others but for the model's "
                f"tolerance, is open by {abs(gaps[worst]):.2g}{where}; the loop is not what it was taken for there",
                RuntimeWarning,
                stacklevel=_level_of_caller(),
            )

    def assemble_sensitivities(
        self,
        q: Numbers,
        u: Numbers,
        p: Numbers = None,
        inputs: Numbers = None,
        t: ArrayLike = 0.0,
        *,
        dq: Numbers = None,
        du: Numbers = None,
        dp: Numbers = None,
        dinputs: Numbers = None,
        dt: ArrayLike | None = None,
    ) -> tuple[Array, Array, Array, Array]:
        """A consistent state and its derivatives along the seeds: q, u, dq (k, ..., nq), du (k, ..., nu).

        Only the independent entries of the seeds are read; the dependent ones follow from closure.
        """
        arrays, batch = self._arguments({"q": q, "u": u, "p": p, "inputs": inputs, "t": t})
        along = {"dq": dq, "du": du, "dp": dp, "dinputs": dinputs, "dt": dt}
        seeds, k, batch = self._directions(along, arrays, batch)
        lengths = {i: _length(arrays["q"][..., i : i + 4]) for i in self._quaternions}
        q_new = self._assembled(arrays, batch)
        u_new = np.broadcast_to(arrays["u"], (*batch, self.nu)).copy()
        dq_new = np.broadcast_to(seeds.get("dq", 0.0), (k, *batch, self.nq)).copy()
        du_new = np.broadcast_to(seeds.get("du", 0.0), (k, *batch, self.nu)).copy()
        for i, length in lengths.items():
            e, de = q_new[..., i : i + 4], dq_new[..., i : i + 4]
            de /= length
            de -= e * np.sum(e * de, axis=-1, keepdims=True)
        if self.closure_names:
            given = {"q": q_new, "u": u_new, "p": p}
            along = {"dq": dq_new, "du": du_new, "dp": dp}
            return q_new, *self._along("completion_sensitivities", given, along)
        return q_new, u_new, dq_new, du_new

    def _warn_of_opening(self, given: Mapping[str, Any], dp: Numbers) -> None:
        """Directions of parameters that open redundant conditions: no derivative exists along them."""
        arrays, batch = self._arguments({name: given[name] for name in ("q", "u", "p") if name in given})
        directions, _, _ = self._directions({"dp": dp}, arrays, batch)
        seeds = directions["dp"].reshape(-1, self.np)
        touched = [j for j in self._opening if np.any(seeds[:, j] != 0.0)]
        if not touched:
            return
        arrays.setdefault("u", np.zeros(self.nu))
        units = {"dp": np.eye(self.np)[touched].reshape(len(touched), *[1] * len(batch), self.np)}
        found = self._target.along(self._functions["closure_sensitivities"], arrays, units, len(touched), batch)[1]
        per_unit = found.reshape(len(touched), -1, len(self.closure_names))
        opened = np.abs(np.einsum("kj,jbc->kbc", seeds[:, touched], per_unit)).max(axis=1, initial=0.0)
        allowed = np.maximum(self._open, OPEN_SEED) * np.maximum(1.0, np.abs(seeds).max(axis=1))[:, None]
        involved = np.any(seeds[np.any(opened > allowed, axis=1)] != 0.0, axis=0)
        worst = np.abs(per_unit).max(axis=1, initial=0.0)
        for j, row in zip(touched, worst, strict=True):
            if involved[j]:
                condition = int(np.argmax(row))
                warnings.warn(
                    f"parameter {self.parameter_names[j]} opens the redundant condition {self.closure_names[condition]} by "
                    f"{row[condition]:.2g} per unit: the loop does not stay closed when it changes alone, and derivatives along "
                    f"it are those of the nearest motion, which keeps what the dependent joints can keep",
                    RuntimeWarning,
                    stacklevel=_level_of_caller(),
                )

    def closure_sensitivities(
        self,
        q: Numbers,
        u: Numbers,
        p: Numbers = None,
        inputs: Numbers = None,
        t: ArrayLike = 0.0,
        *,
        dq: Numbers = None,
        du: Numbers = None,
        dp: Numbers = None,
        dinputs: Numbers = None,
        dt: ArrayLike | None = None,
    ) -> tuple[Array, Array]:
        """Scaled position residuals (..., len(closure_names)), and by how much completed seeds open them, (k, ..., the same).

        The latter is zero to rounding unless conditions are redundant and a direction does not keep them, such as a
        parameter that bends a planar loop out of its plane: then no derivative exists along it.
        """
        given = {"q": q, "u": u, "p": p, "inputs": inputs, "t": t}
        seeds = {"dq": dq, "du": du, "dp": dp, "dinputs": dinputs, "dt": dt}
        if not self.closure_names:
            _, k, batch = self._directions(seeds, *self._arguments(given))
            return np.zeros((*batch, 0)), np.zeros((k, *batch, 0))
        value, derivative = self._along("closure_sensitivities", given, seeds)
        return value, derivative

    def closure(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: ArrayLike = 0.0
    ) -> tuple[Array, Array]:
        """Scaled residuals of the loops in position and velocity, (..., len(closure_names)) each.

        Linear conditions are divided by the loop's characteristic length; the velocities are those of u as it is given.
        """
        arrays, batch = self._arguments({"q": q, "u": u, "p": p, "inputs": inputs, "t": t})
        if not self.closure_names:
            return np.zeros((*batch, 0)), np.zeros((*batch, 0))
        position, velocity = self._target.values(self._functions["closure"], arrays, batch)
        return position, velocity

    # -- both targets --------------------------------------------------------------------------------------------------

    def _compare(self, compiled: CTarget, plain: NumpyTarget, functions: Mapping[str, Function]) -> None:
        """Compare the targets, all functions and directions, at random states; they hold the same statements."""
        rng = np.random.default_rng(0)
        k = 3
        for _, f in itertools.product(range(3), functions.values()):
            arrays: dict[str, Any] = {n: rng.normal(size=self._shapes[n]) for n in ("u", "inputs", "udot", "b")}
            # loops stay closed enough for both targets to be on the same side of every singularity
            spread = 0.03 if self.closure_names else 0.3
            arrays |= {"q": self._initial[0] + spread * rng.normal(size=self.nq), "p": self._left_out["p"], "t": 0.7}
            seeds = {f"d{n}": rng.normal(size=(k, *(self._shapes[n] or (1,)))) for n in arrays}
            with np.errstate(all="ignore"):
                ours, theirs = (_outcome(target, f, arrays, seeds, k) for target in (compiled, plain))
            if isinstance(ours, str) or isinstance(theirs, str):
                if isinstance(ours, str) != isinstance(theirs, str):
                    raise TargetsDifferError(f"{self.name}, {f.name}: only one of C and NumPy finds a singular joint")
                continue
            # what is left open by seeds that were completed is rounding, grown with the condition of the closure matrices
            floor = 1e-9 if f.name == "closure_sensitivities" else 1e-12
            for name, derived, a, b in zip(f.results, f.derived, ours, theirs, strict=True):
                rows = (k, -1) if derived else (1, -1)
                for x, y in zip(a.reshape(rows), b.reshape(rows), strict=True):
                    # a force of the model may have no value at such a state: then in both
                    finite = np.isfinite(x) | np.isfinite(y)
                    x, y = x[finite], y[finite]
                    error = float(np.max(np.abs(x - y), initial=0.0))
                    if not error <= TARGET_TOLERANCE * float(np.max(np.abs(y), initial=0.0)) + floor:
                        raise TargetsDifferError(
                            f"{self.name}: {name} of {f.name} differs by {error:.3g} between C and NumPy; "
                            f"please report this with the model"
                        )


def _places(out: Any, names: Sequence[str], shapes: Sequence[Shape]) -> list[Array]:
    """The arrays of ``out=``, checked."""
    if not isinstance(out, (tuple, list)) or len(out) != len(names):
        raise ValueError(f"out is {type(out).__name__}, expected a tuple of {len(names)} arrays: {', '.join(names)}")
    for name, x, shape in zip(names, out, shapes, strict=True):
        wanted = f"expected a writeable C-contiguous array of float64 of shape {shape}"
        if not isinstance(x, np.ndarray) or isinstance(x, np.ma.MaskedArray):  # whose mask would stay as it is
            raise ValueError(f"out ({name}) is {type(x).__name__}, {wanted}")
        if x.dtype != np.float64 or x.shape != shape:
            raise ValueError(f"out ({name}) holds {x.dtype} and has shape {x.shape}, {wanted}")
        if not x.flags.carray:
            raise ValueError(f"out ({name}) is read-only, not contiguous or not aligned, {wanted}")
    return list(out)


def _overlap(places: Sequence[Array], arrays: Mapping[str, Any]) -> bool:
    """Whether results would be written over arguments, or over one another, while they are read."""
    among = itertools.combinations(places, 2)
    given = itertools.product(places, (a for a in arrays.values() if isinstance(a, np.ndarray)))
    return any(np.may_share_memory(a, b) for a, b in itertools.chain(among, given))


def _outcome(
    target: CTarget | NumpyTarget, f: Function, arrays: Mapping[str, Any], seeds: Mapping[str, Array], k: int
) -> list[Array] | str:
    """Results of a function, or the singular joint."""
    try:
        return target.along(f, arrays, seeds, k, ()) if f.seeds else target.values(f, arrays, ())
    except SingularJointError as error:
        return error.link


def unrolled(value: Any) -> Any:
    """Data of ``model.json`` with its long lists as lists again; see `codegen.emit.repetition`."""
    if isinstance(value, dict):
        return {key: unrolled(v) for key, v in value.items()}
    if not isinstance(value, list):
        return value
    found: list[Any] = []
    for item in value:
        if not (isinstance(item, dict) and "repeat" in item):
            found.append(unrolled(item))
            continue
        start, step = item.get("from", []), item.get("step", [])
        for i in range(item["repeat"]):
            at = [a + i * b for a, b in zip(start, step, strict=True)]
            found += [
                at[x[0]] if isinstance(x, list) else x.format(*at) if isinstance(x, str) else x for x in item["of"]
            ]
    return found


def _times(counts: Mapping[str, Mapping[str, int]], n: int) -> dict[str, dict[str, int]]:
    """Operations of what runs n times."""
    return {part: {k: n * v for k, v in of.items()} for part, of in counts.items()}


def _numbers(name: str, value: Any) -> Array:
    """An array of floats; text, complex numbers and ragged lists are errors."""
    if np.ma.is_masked(value):  # asarray would take what the mask hides
        raise ValueError(f"{name} has masked entries, expected real numbers; fill them first, such as by filled()")
    try:
        array = np.asarray(value)
        if array.dtype.kind in "biufO":
            return array.astype(np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"{name}: {error}; expected an array of real numbers") from None
    raise ValueError(f"{name} holds {array.dtype}, expected real numbers")


def _length(e: Array) -> Array:
    """Lengths of quaternions (..., 4), as (..., 1); their squares may be beyond floating-point numbers."""
    largest = np.abs(e).max(axis=-1, keepdims=True)
    with np.errstate(all="ignore"):
        return largest * np.linalg.norm(e / largest, axis=-1, keepdims=True)


def _sum_of_sizes(numbers: Iterable[Any]) -> float:
    return float(sum(np.sum(np.abs(x)) for x in numbers))


def _level_of_caller() -> int:
    """The stack level of a warning that means a line of the caller, not of this file."""
    level, frame = 1, sys._getframe(1)
    while frame.f_back is not None and frame.f_code.co_filename == __file__:
        level, frame = level + 1, frame.f_back
    return level


def _some(names: Sequence[str]) -> str:
    """Names for a message, not too many."""
    if not names:
        return "(none: the model has none)"
    return ", ".join(names[:12]) + (f", ... ({len(names)} in all)" if len(names) > 12 else "")


FEW = 32
"""So many numbers are looked at one by one in less time than NumPy takes to begin."""


def _is_finite(x: Array) -> bool:
    """Whether all numbers of a row are finite, without arithmetic that could overflow."""
    return all(map(math.isfinite, x.tolist())) if len(x) <= FEW else bool(np.isfinite(x).all())


def _all_finite(x: Array) -> bool:
    flat = x.reshape(-1)
    with np.errstate(all="ignore"):
        return math.isfinite(flat.dot(flat)) or bool(np.isfinite(x).all())  # the first takes half the time


def _of_state(x: Array, batch: Shape, at: tuple[int, ...], rows: int) -> Array:
    """What belongs to a state of a batch, after so many axes in front."""
    missing = len(batch) + rows + 1 - x.ndim
    x = x.reshape(*x.shape[:rows], *(1,) * missing, *x.shape[rows:])
    whole = np.broadcast_to(x, (*x.shape[:rows], *batch, x.shape[-1]))
    return whole[(slice(None),) * rows + at]


MOST_AXES = 29
"""Of batches: NumPy's functions take 32, and results have up to three more."""


def _once(x: Array) -> Array:
    """An array without the repetitions that broadcasting has made."""
    if 0 not in x.strides:
        return x
    return x[tuple(slice(None) if step else slice(0, 1) for step in x.strides)]


def _broadcast(batch: Shape, lead: Shape, arrays: Callable[[], Mapping[str, Any]]) -> Shape:
    try:
        return np.broadcast_shapes(batch, lead)
    except ValueError:
        shapes = {name: np.shape(x) for name, x in arrays().items()}
        seen = ", ".join(f"{n} {shape}" for n, shape in shapes.items() if len(shape) > (n != "t"))
        raise ValueError(
            f"the leading (batch) axes do not broadcast: {seen}; counted from the last, they must be equal or 1"
        ) from None


__all__ = [
    "AssemblyError",
    "Build",
    "CompileError",
    "Jacobians",
    "NoCompilerError",
    "PackageError",
    "SingularJointError",
    "SingularLoopError",
    "SingularSpringError",
    "Solver",
    "TargetsDifferError",
    "compile_library",
    "find_compiler",
]
