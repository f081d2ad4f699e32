"""The C compiler: which one, with which flags, and running it."""

from __future__ import annotations

import contextlib
import functools
import math
import os
import platform
import shlex
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from typing import Any

from ..errors import CompileError, FlagsError, NoCompilerError

STANDARD = ("-std=gnu11", "-fPIC", "-shared")
CFLAGS = "ORDERNM_CFLAGS"
"""What gives other flags in the environment."""

OPTIMIZATION = ("-O2", "-march=native")
"""`CFLAGS` in the environment replaces these. Never -ffast-math: pivots are compared with zero."""

SEARCHES = (
    "--param=lra-max-considered-reload-pseudos=50", "--param=max-cselib-memory-locations=50", "--param=max-combine-insns=2",
)  # fmt: skip
"""How far gcc searches long sums of products: for registers, for loads of what is in one, and for instructions to join. With its
own limits of 500, 500 and 4 it takes up to a fifth longer and finds next to nothing: the same number of instructions to 0.3 per
cent, and of accesses to memory to 0.6."""

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
    given = os.environ.get(CFLAGS)
    try:
        flags = list(OPTIMIZATION) if given is None else shlex.split(given)
    except ValueError as error:
        raise FlagsError(f"ORDERNM_CFLAGS={given} cannot be split into flags: {error}") from None
    _refuse_forbidden("ORDERNM_CFLAGS", flags)
    return flags


def searches(command: Sequence[str]) -> tuple[str, ...]:
    """Flags of gcc's beside `optimization`, unless the environment gives flags; other compilers know none of these."""
    is_gcc = "Free Software Foundation" in compiler_version(tuple(command))
    return SEARCHES if is_gcc and CFLAGS not in os.environ else ()


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


@functools.cache
def processor() -> str:
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
def compiler_version(command: tuple[str, ...]) -> str:
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


class Stop:
    """What another thread stops compilers by.

    Attributes
    ----------
    begun : threading.Event
        Compilers run.
    """

    def __init__(self) -> None:
        self.asked = False
        self.begun = threading.Event()
        self.running: list[subprocess.Popen[bytes]] = []

    def now(self) -> None:
        """End those that run; none is begun afterwards."""
        self.asked = True
        for process in list(self.running):
            with contextlib.suppress(OSError):
                os.killpg(process.pid, signal.SIGKILL)


def run_all(commands: list[list[str]], stop: Stop | None = None) -> tuple[bool, str]:
    """Run commands side by side; whether one failed, and what they said.

    Raises
    ------
    CompileError
        One took too long. All are stopped then, with what they have started, and also when the user interrupts.
    """
    log = []
    failed = False
    stop = stop or Stop()
    running = stop.running = []
    seconds = compile_seconds()
    end = time.monotonic() + seconds
    try:
        with _interrupts_wait():  # a process is known before anything can end its start
            for c in commands:
                if stop.asked:
                    return True, f"{COMMAND}{shlex.join(c)}\nstopped\n"
                running.append(
                    subprocess.Popen(
                        c,
                        stdin=subprocess.DEVNULL,
                        stdout=subprocess.PIPE,
                        stderr=subprocess.STDOUT,
                        start_new_session=True,
                    )
                )
        stop.begun.set()
        if stop.asked:  # by somebody who did not know the last one yet
            return True, "stopped\n"
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
