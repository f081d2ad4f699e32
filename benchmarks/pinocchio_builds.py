"""Pinocchio's template library at its best: the same source compiled in several ways, of which the fastest counts.

Which one that is differs from model to model: small matrices are often faster without Eigen's vector instructions, or without
AVX-512. The first run compiles for minutes, two builds at a time; libraries stay in the cache folder.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

from ctiming import INSTRUCTIONS
from loops_against_pinocchio import FLAGS, include_folders

SOURCE = Path(__file__).parent / "pinocchio_derivatives.cpp"
AT_ONCE = 2
"""Compilers that run side by side."""


class Build(NamedTuple):
    """Compiler and flags; `instructions` are those of `ctiming.INSTRUCTIONS` that it may use."""

    compiler: str
    instructions: str
    flags: tuple[str, ...]

    def __str__(self) -> str:
        words = [self.compiler, *self.flags, *(["without AVX-512"] if self.instructions == "avx2" else [])]
        return " ".join(words).replace("-DEIGEN_DONT_VECTORIZE", "Eigen not vectorised")


PLAIN = "-DEIGEN_DONT_VECTORIZE"
BUILDS = (
    Build("g++", "native", ("-O3",)),
    Build("g++", "native", ("-O3", PLAIN)),
    Build("g++", "avx2", ("-O3",)),
    Build("g++", "avx2", ("-O3", PLAIN)),
    Build("g++", "native", ("-O2",)),
    Build("g++", "avx2", ("-O2",)),
    Build("clang++", "native", ("-O3",)),
    Build("clang++", "avx2", ("-O3",)),
)
"""The widest instructions are no must: on a machine with AVX-512 builds without them compete too."""


def libraries(cache: Path, chosen: tuple[Build, ...] = BUILDS) -> dict[Build, Path]:
    """Shared libraries of all builds whose compiler is installed."""
    there = [b for b in chosen if shutil.which(b.compiler)]
    if not there:
        raise SystemExit(f"none of {', '.join(dict.fromkeys(b.compiler for b in chosen))} is installed")
    cache.mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(AT_ONCE) as pool:
        return dict(zip(there, pool.map(lambda b: _library(b, cache), there), strict=True))


def _library(build: Build, cache: Path) -> Path:
    version = subprocess.run([build.compiler, "--version"], capture_output=True, text=True, check=True).stdout
    flags = ["-march=native", *INSTRUCTIONS[build.instructions], *build.flags, "-fPIC", "-shared"]
    words = [build.compiler, *FLAGS, *flags, *include_folders()]
    target = (
        cache / f"pinocchio-{hashlib.sha256(repr((SOURCE.read_text(), words, version)).encode()).hexdigest()[:20]}.so"
    )
    if not target.exists():
        print(f"compiling Pinocchio, {build}: minutes", flush=True)
        unfinished = target.with_suffix(f".{os.getpid()}")
        subprocess.run([*words, str(SOURCE), "-o", str(unfinished)], check=True)
        unfinished.rename(target)
    return target
