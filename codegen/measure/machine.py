"""On what something was measured: processor, instructions, compiler and flags, versions."""

from __future__ import annotations

import os
import platform
import subprocess
from pathlib import Path

import numpy as np
import scipy

from ..runtime.standalone.files.compiler import STANDARD, compiler_version, find_compiler, optimization
from ..version import __version__

INSTRUCTIONS = (
    ("__AVX512F__", "AVX-512"), ("__AVX2__", "AVX2"), ("__AVX__", "AVX"), ("__SSE2__", "SSE2"), ("__ARM_NEON", "NEON"),
)  # fmt: skip
"""Macros that compilers define, the widest vectors first."""


def machine() -> dict[str, str]:
    """What a reader of figures has to know.

    Raises
    ------
    NoCompilerError, FlagsError
    """
    command, flags = find_compiler(), optimization()
    first = compiler_version(tuple(command)).splitlines()
    return {
        "processor": processor_name(),
        "cores": str(os.cpu_count() or 1),
        "system": f"{platform.system()} {platform.machine()}",
        "instructions": instructions(command, flags),
        "compiler": first[0] if first else Path(command[0]).name,
        "flags": " ".join([*STANDARD, *flags]),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "ordernm": __version__,
    }


def processor_name() -> str:
    """As the system calls it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def instructions(command: list[str], flags: list[str]) -> str:
    """The widest vector instructions that these flags let a compiler use."""
    try:
        done = subprocess.run(
            [*command, *flags, "-dM", "-E", "-x", "c", os.devnull], stdin=subprocess.DEVNULL, capture_output=True, text=True,
            check=False, timeout=60,
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired):
        return "unknown"
    return next((name for macro, name in INSTRUCTIONS if f"{macro} " in done.stdout), "no vector instructions")
