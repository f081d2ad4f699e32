"""Opens generated packages, and saved trajectories."""

from __future__ import annotations

import hashlib
import importlib.util
import os
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

from ..wording import with_article
from .sections import CARRIED, is_carried
from .solver import Solver
from .standalone.errors import PackageError
from .standalone.files.manifest import SEAL, check_files, read_manifest
from .standalone.trajectory.trajectory import Trajectory


def load(folder: str | os.PathLike[str], target: str | None = None) -> Solver:
    """Open a generated package.

    Its C code is compiled at the first call and cached. A package of this version is run by `codegen.runtime.Solver`. A
    package of another version is run by the code that it carries, which also defines the classes of its errors and
    functionals.

    Parameters
    ----------
    folder : path
        The folder that `generate` wrote.
    target : {"c", "numpy", "both"}, optional
        The code that computes. Default: the target that the package was generated for.

    Returns
    -------
    Solver
        The solver of the package.

    Raises
    ------
    PackageError
        If the folder holds no generated package, or a damaged one.
    CompileError
        If the compiler fails.
    TargetsDifferError
        If `target` is "both" and the two targets disagree.

    Examples
    --------
    >>> report = ordernm.generate("examples/pendulum.yaml", "pendulum", compile=False)
    >>> pendulum = ordernm.load("pendulum", target="numpy")
    >>> pendulum.nq, pendulum.target
    (1, 'numpy')
    """
    _check_path(folder, "the folder of a generated package")
    if "\n" in os.fspath(folder):
        raise PackageError("this is a text of several lines; the folder of a generated package is needed")
    path = Path(folder).absolute()
    brought = _brought(path)
    ours = all(_is_own(path / CARRIED, file) for file in brought)
    if ours or _is_sealed(path):  # other code may belong to a version without seals
        check_files(path, read_manifest(path), (".py",))
    found: Solver = Solver(path, target) if ours else _package(path, brought).Solver(target)
    return found


def load_trajectory(path: str | os.PathLike[str]) -> Trajectory:
    """Read a saved trajectory; the same as `Trajectory.load`.

    Parameters
    ----------
    path : path
        A file that `Trajectory.save` wrote: ``.npz``, or ``.parquet``, which needs pyarrow.

    Returns
    -------
    Trajectory
        The motion, equal to the saved one in every bit.

    Raises
    ------
    TrajectoryFileError
        A ValueError, if the file is of another kind or damaged.

    Examples
    --------
    >>> solver.simulate(1.0).save("swing.npz")
    >>> ordernm.load_trajectory("swing.npz").model
    'double_pendulum'
    """
    _check_path(path, "the file of a trajectory")
    return Trajectory.load(path)


def _check_path(given: Any, wanted: str) -> None:
    """Raises TypeError for an object that is no path."""
    if not isinstance(given, (str, os.PathLike)):
        raise TypeError(f"{with_article(type(given).__name__)} is given; {wanted} is needed")


def _is_sealed(path: Path) -> bool:
    """Whether there is a ``model.json`` with a seal; the seal need not be valid."""
    try:
        return SEAL in (path / "model.json").read_text(encoding="utf-8")
    except (OSError, ValueError):
        return False


def _brought(path: Path) -> list[Path]:
    """The files of the run time in a package; packages of earlier versions have a single file."""
    one = path / f"{CARRIED}.py"
    return [one] if one.is_file() else sorted((path / CARRIED).rglob("*.py"))


def _is_own(folder: Path, file: Path) -> bool:
    try:
        module = ".".join(file.relative_to(folder).with_suffix("").parts)
        return is_carried(module, file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False


def _package(path: Path, brought: list[Path]) -> ModuleType:
    """A generated package as a module; if its files have changed, it is loaded as a new module."""
    key = hashlib.sha256(str(path).encode())
    for file in (path / "__init__.py", *brought):
        key.update(file.read_bytes())
    name = f"ordernm_generated_{key.hexdigest()[:16]}"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(
            name, path / "__init__.py", submodule_search_locations=[str(path)]
        )
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        try:
            spec.loader.exec_module(module)
        except BaseException:
            for begun in [m for m in sys.modules if m == name or m.startswith(f"{name}.")]:
                del sys.modules[begun]
            raise
    return sys.modules[name]
