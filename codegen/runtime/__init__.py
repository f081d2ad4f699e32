"""Running generated solvers: `load` opens a generated package wherever it lies."""

from __future__ import annotations

import os
from pathlib import Path

from .solver import AssemblyError, CompileError, Jacobians, NoCompilerError, SingularJointError, Solver

__all__ = [
    "AssemblyError",
    "CompileError",
    "Jacobians",
    "NoCompilerError",
    "SingularJointError",
    "Solver",
    "load",
]


def load(folder: str | os.PathLike[str], target: str | None = None) -> Solver:
    """Open a generated package; its C is compiled on first use and cached.

    Parameters
    ----------
    folder : path
        What `generate` wrote.
    target : {"c", "numpy", "both"}, optional
        Left out: what it was generated for.

    Returns
    -------
    Solver

    Raises
    ------
    ValueError
        The folder holds no generated package.
    CompileError
    """
    path = Path(folder).resolve()
    if not (path / "model.json").is_file():
        raise ValueError(
            f"{folder} holds no generated solver (no model.json in it); make one with: generate MODEL.yaml"
        )
    return Solver(path, target)
