"""The NumPy module of a package, called like its C."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array, Shape, dtype_of, of_state
from ..errors import SingularForceError, SingularJointError, SingularLoopError, SingularOutputError, singular_forces
from .arguments import NO_SEEDS, Seeds
from .functions import Function
from .results import put
from .single_calls import NoCalls


class NumpyTarget:
    """The NumPy module of a package."""

    name = "numpy"

    def __init__(self, folder: Path, manifest: Mapping[str, Any]):
        self.threads = 1
        self.calls = NoCalls()
        self.dtype = dtype_of(manifest)
        self.couplings = frozenset(manifest.get("couplings", ()))
        self.singular_forces = dict(singular_forces(manifest))
        module = f"{manifest['name']}_numpy"
        self.module: Any = self._load(module, folder / f"{module}.py")

    def _load(self, name: str, file: Path) -> Any:
        """The module of a file."""
        spec = importlib.util.spec_from_file_location(name, file)
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    def compute(
        self,
        f: Function,
        arrays: Mapping[str, Any],
        batch: Shape,
        seeds: Seeds = NO_SEEDS,
        out: Sequence[Array] = (),
        failed: dict[int, SingularJointError] | None = None,
    ) -> list[Array]:
        """See `CTarget.compute`."""
        k, axes = seeds.k, (1,) * len(batch)
        along = [seeds.of[s] if s in seeds.of else np.zeros((k, *axes, n)) for s, n in f.seeds.items()]
        given = [
            *(arrays[a] for a in f.arguments),
            *(x[..., 0] if s == "dt" else x for s, x in zip(f.seeds, along, strict=True)),
        ]
        try:
            return self._call(f, given, f.whole_shapes(batch, k), out)
        except SingularJointError:
            if failed is None:
                raise
        return self._one_by_one(f, arrays, batch, seeds, out, failed)

    def _one_by_one(
        self,
        f: Function,
        arrays: Mapping[str, Any],
        batch: Shape,
        seeds: Seeds,
        out: Sequence[Array],
        failed: dict[int, SingularJointError],
    ) -> list[Array]:
        """Each state of a batch alone: some of them cannot be computed."""
        results = list(out) or [np.full(shape, np.nan, self.dtype) for shape in f.whole_shapes(batch, seeds.k)]
        for number, at in enumerate(np.ndindex(*batch)):
            alone = {
                n: float(np.broadcast_to(a, batch)[at]) if n == "t" else of_state(a, batch, at, 0)
                for n, a in arrays.items()
            }
            along = Seeds({s: of_state(a, batch, at, 1) for s, a in seeds.of.items()}, seeds.k)
            try:
                found = self.compute(f, alone, (), along)
            except SingularJointError as error:
                failed[number] = error
                continue
            for r, x, derived in zip(results, found, f.derived, strict=True):
                r[(slice(None), *at) if derived else at] = x
        return results

    def _call(self, f: Function, arguments: list[Any], shapes: list[Shape], out: Sequence[Array]) -> list[Array]:
        found = [np.asarray(r, self.dtype) for r in self._results(f, arguments)]
        return put([_full(r, s, shape) for r, s, shape in zip(found, f.shapes, shapes, strict=True)], out)

    def _results(self, f: Function, arguments: list[Any]) -> Any:
        """What a function of the module returns."""
        try:
            with np.errstate(all="ignore"):  # what is not finite is told by the solver, for both targets alike
                return getattr(self.module, f.name)(*arguments)
        except self.module.SingularJointError as error:
            name = type(error).__name__
            if name == SingularForceError.__name__:
                raise SingularForceError(error.link, self.singular_forces[error.link]) from None
            if name == SingularLoopError.__name__:
                raise SingularLoopError(error.link, coupled=error.link in self.couplings) from None
            kind = SingularOutputError if name == SingularOutputError.__name__ else SingularJointError
            raise kind(error.link) from None


def in_rows(x: Array, shape: Shape) -> Array:
    """The same numbers with the last axes of that shape; the module has those of all bodies in one row."""
    return x if len(shape) < 2 or x.shape[-len(shape) :] == shape else x.reshape(*x.shape[:-1], *shape)


def _full(x: Array, alone: Shape, whole: Shape) -> Array:
    """An array of its own of the whole shape; arguments without batch axes give results without them."""
    x = in_rows(x, alone)
    return x if x.shape == whole else np.broadcast_to(x, whole).copy()
