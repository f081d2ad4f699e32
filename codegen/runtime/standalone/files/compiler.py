"""The C compiler: its command, its flags, and running it."""

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
"""Name of the environment variable that replaces the default flags."""

OPTIMIZATION = ("-O2", "-march=native")
"""Default flags, replaced by the environment variable `CFLAGS`. Never -ffast-math, because pivots are compared with zero."""

SEARCHES = (
    "--param=lra-max-considered-reload-pseudos=50", "--param=max-cselib-memory-locations=50", "--param=max-combine-insns=2",
)  # fmt: skip
"""Limits of gcc's searches in long sums of products: for registers, for loads, and for instructions to combine. gcc's own limits
of 500, 500 and 4 take up to 20 per cent longer, and change the number of instructions by 0.3 per cent and of memory accesses by
0.6 per cent."""

COMPILE_SECONDS = 600.0
"""Seconds after which a compiler is stopped; the environment variable ``ORDERNM_COMPILE_SECONDS`` sets another
limit."""

LONGEST_WAIT = 1e6
"""Longest wait, s, since the system counts milliseconds in a limited range."""

VERSION_SECONDS = 60.0
"""Time limit for printing the compiler's version, in seconds."""

COMMAND = "$ "
"""Prefix of lines of a log that are commands."""

FORBIDDEN = (
    "-ffast-math", "-Ofast", "-ffinite-math-only", "-funsafe-math-optimizations", "-fassociative-math", "-fno-honor-nans",
    "-fno-honor-infinities", "-ffp-model=fast", "-ffp-model=aggressive", "-fsingle-precision-constant",
)  # fmt: skip
"""Flags that break sines and cosines (which are sums of parts), pivots, or tests for infinite numbers."""


def find_compiler() -> list[str]:
    """The command of the C compiler: the environment variable ``CC``, else cc, gcc or clang.

    Raises
    ------
    NoCompilerError
    FlagsError
        If ``CC`` contains flags that change floating-point arithmetic.
    """
    try:
        given = shlex.split(os.environ.get("CC", ""))
    except ValueError as error:
        raise NoCompilerError(f"no C compiler found: CC={os.environ['CC']} is not a valid command ({error})") from None
    _refuse_forbidden("CC", given)
    for command in [given] if given else [["cc"], ["gcc"], ["clang"]]:
        path = shutil.which(command[0])
        if path:
            return [path, *command[1:]]
    what = f"CC={' '.join(given)} was not found" if given else "none of cc, gcc and clang is on the PATH"
    raise NoCompilerError(f"no C compiler found: {what}; install gcc or clang, or set CC")


def optimization() -> list[str]:
    """Compiler flags in addition to those in `STANDARD`.

    Raises
    ------
    FlagsError
        If ``ORDERNM_CFLAGS`` contains flags that change floating-point arithmetic.
    """
    given = os.environ.get(CFLAGS)
    try:
        flags = list(OPTIMIZATION) if given is None else shlex.split(given)
    except ValueError as error:
        raise FlagsError(f"ORDERNM_CFLAGS={given} cannot be split into flags: {error}") from None
    _refuse_forbidden("ORDERNM_CFLAGS", flags)
    return flags


def searches(command: Sequence[str]) -> tuple[str, ...]:
    """Additional flags for gcc only, unless the environment gives flags."""
    is_gcc = "Free Software Foundation" in compiler_version(tuple(command))
    return SEARCHES if is_gcc and CFLAGS not in os.environ else ()


def _refuse_forbidden(variable: str, flags: Sequence[str]) -> None:
    for flag in flags:
        if flag in FORBIDDEN:
            raise FlagsError(
                f"{variable} contains {flag}, which breaks sines, cosines and the detection of singular joints; use -O3, say"
            )


def compile_seconds() -> float:
    """Time limit for a compiler, in seconds.

    Raises
    ------
    FlagsError
        If ``ORDERNM_COMPILE_SECONDS`` is not a positive number.
    """
    given = os.environ.get("ORDERNM_COMPILE_SECONDS", "")
    try:
        seconds = float(given) if given else COMPILE_SECONDS
    except ValueError:
        seconds = math.nan
    if not seconds > 0.0:
        raise FlagsError(
            f"ORDERNM_COMPILE_SECONDS={given}, expected a positive number; the default is {COMPILE_SECONDS:g}"
        )
    return min(seconds, LONGEST_WAIT)


@functools.cache
def processor() -> str:
    """The properties of the processor that determine the result of -march=native."""
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
    """The compiler's version text, which distinguishes compilers of the same name."""
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
            f"the C compiler does not answer: {shlex.join([*command, '--version'])} did not finish; set CC to "
            f"another compiler"
        ) from None


@contextlib.contextmanager
def _interrupts_wait() -> Iterator[None]:
    """Delays Ctrl-C to the end of the block. Only the main thread receives signals."""
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
    """Lets another thread stop running compilers.

    Attributes
    ----------
    begun : threading.Event
        Set once compilers are running.
    """

    def __init__(self) -> None:
        self.asked = False
        self.begun = threading.Event()
        self.running: list[subprocess.Popen[bytes]] = []

    def now(self) -> None:
        """Stops all running compilers, and prevents further compilers from starting."""
        self.asked = True
        for process in list(self.running):
            with contextlib.suppress(OSError):
                os.killpg(process.pid, signal.SIGKILL)


def run_all(commands: list[list[str]], stop: Stop | None = None) -> tuple[bool, str]:
    """Runs commands in parallel; returns whether a command failed, and the output of all.

    Raises
    ------
    CompileError
        If a command takes too long. Then, and after Ctrl-C, all commands are stopped with their child processes.
    """
    log = []
    failed = False
    stop = stop or Stop()
    running = stop.running = []
    seconds = compile_seconds()
    end = time.monotonic() + seconds
    try:
        with _interrupts_wait():  # Ctrl-C waits until every process is in the list
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
        if stop.asked:  # `Stop.now` may have run before the last process was in the list
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
            f"the C compiler did not finish within {seconds:g} s: {shlex.join(command)}; if it needs longer, set "
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
