"""Pinocchio's template library at its best: the same source compiled in several ways, of which the fastest counts.

Which one that is differs from model to model: small matrices are often faster without Eigen's vector instructions, or without
AVX-512. The first run compiles for minutes, two builds at a time; what is compiled stays in the cache folder. ``CMEEL_PREFIX``
may name the folder with Pinocchio's headers where it is not that of this interpreter's packages.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sysconfig
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

from codegen.measure.compiled import INSTRUCTIONS, Workshop

HERE = Path(__file__).parent
FLAGS = (
    "-std=c++17", "-DNDEBUG", "-w", "-DBOOST_MPL_LIMIT_LIST_SIZE=30", "-DBOOST_MPL_LIMIT_VECTOR_SIZE=30",
    "-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS", "-DBOOST_FUSION_INVOKE_MAX_ARITY=12", "-DPINOCCHIO_IGNORE_DEPRECATED_HEADER",
)  # fmt: skip
SCALAR = "-DEIGEN_DONT_VECTORIZE"
WORDS = {SCALAR: "Eigen not vectorised", "-DJOINTS=HingesOnly": "hinges only",
         "-DJOINTS=pinocchio::JointCollectionDefaultTpl": "all joints"}  # fmt: skip
AT_ONCE = 2
"""Compilers that run side by side."""


class Build(NamedTuple):
    """Compiler, the instructions that it may use, of `INSTRUCTIONS`, and flags."""

    compiler: str = "g++"
    instructions: str = "native"
    flags: tuple[str, ...] = ("-O3",)

    def __str__(self) -> str:
        words = [self.compiler, *(WORDS.get(f, f) for f in self.flags)]
        return " ".join([*words, *(["without AVX-512"] if self.instructions == "avx2" else [])])


def include_folders() -> list[str]:
    """Options that name the headers of Pinocchio and of Eigen."""
    prefix = Path(os.environ.get("CMEEL_PREFIX", Path(sysconfig.get_path("purelib")) / "cmeel.prefix"))
    if not (prefix / "include" / "pinocchio").is_dir():
        raise SystemExit(f"no Pinocchio headers in {prefix / 'include'}: pip install pin, or set CMEEL_PREFIX")
    eigen = [p for p in (prefix / "include" / "eigen3", Path("/usr/include/eigen3")) if p.is_dir()]
    if not eigen:
        raise SystemExit("no Eigen headers: pip install cmeel-eigen, or install libeigen3-dev")
    return [word for folder in (prefix / "include", eigen[0]) for word in ("-isystem", str(folder))]


def compiled(name: str, build: Build, shop: Workshop, shared: bool = True) -> Path:
    """One of the C++ files as a library or a program, compiled or taken from the cache."""
    texts = [(HERE / file).read_text() for file in (f"{name}.cpp", "pinocchio_mechanisms.hpp")]
    flags = [*INSTRUCTIONS[shop.instructions], *INSTRUCTIONS[build.instructions], *build.flags]
    words = [
        build.compiler,
        *FLAGS,
        *(["-march=native", "-fPIC", "-shared"] if shared else []),
        *flags,
        *include_folders(),
    ]
    version = subprocess.run([build.compiler, "--version"], capture_output=True, text=True, check=True).stdout
    target = shop.folder / f"{name}-{hashlib.sha256(repr((texts, words, version)).encode()).hexdigest()[:20]}"
    if not target.exists():
        shop.folder.mkdir(parents=True, exist_ok=True)
        print(f"compiling {name}.cpp, {build}: minutes", flush=True)
        unfinished = target.with_suffix(f".{os.getpid()}")
        subprocess.run([*words, str(HERE / f"{name}.cpp"), "-o", str(unfinished), "-ldl"], check=True)
        unfinished.rename(target)
    return target


def libraries(name: str, builds: Sequence[Build], shop: Workshop) -> dict[Build, Path]:
    """Shared libraries of all builds whose compiler is installed."""
    there = [b for b in builds if shutil.which(b.compiler)]
    if not there:
        raise SystemExit(f"none of {', '.join(dict.fromkeys(b.compiler for b in builds))} is installed")
    with ThreadPoolExecutor(AT_ONCE) as pool:
        return dict(zip(there, pool.map(lambda b: compiled(name, b, shop), there), strict=True))
