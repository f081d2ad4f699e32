"""The system of a measurement: processor, instructions, compiler with flags, versions."""

from __future__ import annotations

import os
import platform
import subprocess
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

from ..runtime.standalone.files.compiler import STANDARD, compiler_version, find_compiler, optimization
from ..version import __version__

INSTRUCTIONS = (
    ("__AVX512F__", "AVX-512"), ("__AVX2__", "AVX2"), ("__AVX__", "AVX"), ("__SSE2__", "SSE2"), ("__ARM_NEON", "NEON"),
)  # fmt: skip
"""Macros that compilers define for instruction sets, widest vectors first."""


def machine() -> dict[str, str]:
    """The properties of the system that a reader of figures needs.

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
        "instructions": instructions([*command, *flags]) or "no vector instructions",
        "compiler": first[0] if first else Path(command[0]).name,
        "flags": " ".join([*STANDARD, *flags]),
        "python": platform.python_version(),
        "numpy": version("numpy"),
        "scipy": version("scipy"),
        "ordernm": __version__,
    }


def processor_name() -> str:
    """The name of the processor, as the system reports it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def instructions(command: Sequence[str]) -> str:
    """The widest vector instructions that a compiler with flags uses on this machine; empty if unknown."""
    try:
        done = subprocess.run(
            [*command, "-dM", "-E", "-x", "c", os.devnull],
            stdin=subprocess.DEVNULL, capture_output=True, text=True, errors="replace", timeout=10, check=False,
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired):
        return ""
    return next((name for macro, name in INSTRUCTIONS if f"#define {macro} " in done.stdout), "")
