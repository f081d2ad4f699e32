"""Calls the NumPy module of a package, as `c_target` calls the compiled C code."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array, Shape, of_state
from ..errors import SingularForceError, SingularJointError, SingularLoopError, SingularOutputError, singular_forces
from .arguments import Seeds
from .functions import Function
from .task import Target, Task


class NumpyTarget(Target):
    """Computes the functions of a package with its NumPy module."""

    name = "numpy"

    def __init__(self, folder: Path, manifest: Mapping[str, Any]):
        super().__init__(manifest)
        self.singular_forces = dict(singular_forces(manifest))
        module = f"{manifest['name']}_numpy"
        self.module: Any = self._load(module, folder / f"{module}.py")

    def _load(self, name: str, file: Path) -> Any:
        """The module that a file contains."""
        spec = importlib.util.spec_from_file_location(name, file)
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    def run(self, task: Task) -> bool:
        task.look()
        f, of, k = task.f, task.seeds.of, task.seeds.k
        axes = (1,) * len(task.batch)
        along = [of[s] if s in of else np.zeros((k, *axes, n)) for s, n in f.seeds.items()]
        along = [x[..., 0] if s == "dt" else x for s, x in zip(f.seeds, along, strict=True)]
        try:
            found = self._call(f, [*(task.arrays[a] for a in f.arguments), *along])
        except SingularJointError:
            if task.failed is None:
                raise
            self._one_by_one(task, task.failed)
            return False
        for place, x, shape in zip(task.out, found, f.shapes, strict=True):
            if place is not None:
                place[...] = in_rows(x, shape, place.ndim)
        return False

    def _one_by_one(self, task: Task, failed: dict[int, SingularJointError]) -> None:
        """Computes each state of a batch separately, since some states have failed; records the errors in `failed`."""
        for number, at in enumerate(np.ndindex(*task.batch)):
            along = Seeds({s: of_state(a, task.batch, at, 1) for s, a in task.seeds.of.items()}, task.seeds.k)
            try:
                found = self.compute(task.f, task.at(at), (), along)
            except SingularJointError as error:
                failed[number] = error
                continue
            for r, x, derived in zip(task.out, found, task.f.derived, strict=True):
                if r is not None:
                    r[(slice(None), *at) if derived else at] = x
        task.spoil(task.out, task.f.derived, failed)

    def _call(self, f: Function, arguments: list[Any]) -> list[Array]:
        return [np.asarray(r, self.dtype) for r in self._results(f, arguments)]

    def _results(self, f: Function, arguments: list[Any]) -> Any:
        """The results of a function of the module."""
        try:
            with np.errstate(all="ignore"):  # the solver itself warns of results that are not finite
                return getattr(self.module, f.name)(*arguments)
        except self.module.SingularJointError as error:
            name = type(error).__name__
            if name == SingularForceError.__name__:
                raise SingularForceError(error.link, self.singular_forces[error.link]) from None
            if name == SingularLoopError.__name__:
                raise SingularLoopError(error.link, coupled=error.link in self.couplings) from None
            kind = SingularOutputError if name == SingularOutputError.__name__ else SingularJointError
            raise kind(error.link) from None


def in_rows(x: Array, shape: Shape, axes: int) -> Array:
    """Reshapes a result to `axes` axes, the last of which have the shape `shape`; the module returns the numbers of all
    bodies in one row."""
    return x if len(shape) < 2 or x.ndim == axes else x.reshape(*x.shape[:-1], *shape)
