"""``ordernm doctor``: compiler, processor, optional packages and cache of this machine, and whether a solver compiles."""

from __future__ import annotations

import argparse
import importlib.util
import platform
import sys
import tempfile
from pathlib import Path

from .ending import COMPILING_FAILED, OK
from .terminal import StatusLine
from .version import __version__

EXTRAS = {
    "plot": (("matplotlib", "PIL"), "curves, pictures, animations, reports"),
    "view": (("viser", "trimesh", "collada"), "views in a browser, mesh files"),
    "dataframe": (("pandas",), "trajectories as tables"),
    "parquet": (("pyarrow",), "trajectories in .parquet files"),
    "mjcf": (("mujoco",), "import of MJCF"),
    "completion": (("shtab",), "completion of commands in shells"),
    "casadi": (("casadi",), "functions of solvers in CasADi"),
    "jax": (("jax",), "functions of solvers in JAX"),
    "torch": (("torch",), "functions of solvers in PyTorch"),
    "fmi": (("ziglang", "fmpy"), "FMUs for other systems, simulators of FMUs"),
    "peers": (("casadi", "pinocchio", "mujoco"), "comparisons in benchmarks"),
}
"""Extras of the package ordernm for users, each with modules that it installs, and their purpose."""

NOT_THERE = "missing"


def run_doctor(options: argparse.Namespace, status: StatusLine) -> int:
    """``ordernm doctor``; exit code 3 if a solver cannot be compiled."""
    status("compiling a solver", 0, 0)
    compiles = _compiles()
    status.close()
    compiler = [*_compiler(), *compiles[1]]
    parts = {"ordernm": _self(), "compiler": compiler, "extras": _extras(), "cache": _cache()}
    for title, lines in parts.items():
        print(title)
        for line in lines:
            print(f"  {line}")
    return OK if compiles[0] else COMPILING_FAILED


def add_doctor_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of ``ordernm doctor``: there are none."""


def _self() -> list[str]:
    from .runtime.standalone.calls.threads import processors

    where = Path(__file__).parent
    return [
        f"version {__version__} in {where}",
        f"Python {platform.python_version()} ({sys.executable})",
        f"{platform.system()} {platform.machine()}, {processors()} processors may be used",
    ]


def _compiler() -> list[str]:
    """Lines about the C compiler: its command, its flags, and the instruction set for which it compiles."""
    from .measure.machine import machine
    from .runtime.standalone.errors import CompileError, NoCompilerError

    try:
        found = machine()
    except (NoCompilerError, CompileError) as error:
        return [str(error)]
    return [f"{found['compiler']}", f"flags {found['flags']}", f"{found['processor']}: {found['instructions']}"]


def _compiles() -> tuple[bool, list[str]]:
    """Whether a small solver compiles and agrees with the generic engine, and lines that say so."""
    from .generation import generate
    from .model import parse_model
    from .runtime.standalone.errors import CompileError, NoCompilerError, PackageError, TargetsDifferError
    from .starters import DEFAULT, text_of

    with tempfile.TemporaryDirectory(prefix="ordernm-", ignore_cleanup_errors=True) as folder:
        try:
            report = generate(parse_model(text_of(DEFAULT, "doctor")), Path(folder, "doctor"), check=True)
        except (NoCompilerError, CompileError, PackageError, TargetsDifferError, OSError) as error:
            return False, [f"a solver does not compile: {error}", "packages compute with NumPy until it does (slower)"]
    if report.disagreeing:
        return False, [
            f"a solver compiles, but its results differ from those of the generic engine: {report.disagreeing}",
            "look for options of the compiler in CC and ORDERNM_CFLAGS that change results, such as -ffast-math",
        ]
    return True, ["a solver compiles, and agrees with the generic engine"]


def _extras() -> list[str]:
    checkout = Path(__file__).parents[1]
    of_checkout = (checkout / "pyproject.toml").is_file()
    lines = []
    for name, (modules, purpose) in EXTRAS.items():
        missing = [m for m in modules if importlib.util.find_spec(m) is None]
        install = f'-e "{checkout}[{name}]"' if of_checkout else f'"ordernm[{name}]"'
        state = f"{NOT_THERE}: pip install {install}" if missing else "installed"
        lines.append(f"{name:10}  {purpose}: {state}")
    return lines


def _cache() -> list[str]:
    from .runtime.standalone.files.user_cache import user_cache

    try:
        place = user_cache()
        files = [f for f in place.rglob("*") if f.is_file()] if place.is_dir() else []
    except (OSError, RuntimeError) as error:
        return [f"none: {error}"]
    return [
        f"{place}: {len(files)} files, {sum(f.stat().st_size for f in files) / 1e6:.1f} MB; delete it to begin anew"
    ]
