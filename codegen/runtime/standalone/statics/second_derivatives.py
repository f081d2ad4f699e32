"""Second derivatives: the NumPy functions along seeds, evaluated with dual numbers (forward over forward)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ....elementary import ELEMENTWISE
from ..arrays import Array, Shape
from ..calls.numpy_target import NumpyTarget
from ..calls.targets import Opened
from .jets import ELEMENTARY, Jet, choice, value_of, vanishing


class SecondDerivatives:
    """The NumPy module of a partition, evaluated with jets.

    The module has the same statements as the C code, written elementwise, so they work for any number type with elementary
    functions. A function along seeds computes directional derivatives; with jets, it also returns their derivatives.
    """

    def __init__(self, opened: Opened):
        self.functions, self.opened = opened.functions, opened
        # a separate copy of the module, in which the conversion of arguments and results is replaced
        module: Any = NumpyTarget(opened.folder, opened.manifest).module
        module.Call, module.result = _call_of_jets(module.Call), _result_of_jets(module.result)
        module.choice, module.vanishing = choice, vanishing
        vars(module).update((name, ELEMENTARY[name]) for name in ELEMENTWISE)
        self.module = module

    def along(self, name: str, given: Mapping[str, Any], seeds: Mapping[str, Any]) -> list[Jet]:
        """The results of a function along seeds, as jets.

        Parameters
        ----------
        name : str
            Name of the function, such as ``"sensitivities"``.
        given : dict
            q, u, p, inputs, t: arrays or jets.
        seeds : dict
            Arrays or jets, directions first: (k, n) or (k, ..., n); dt (k,). Missing ones are zero.

        Returns
        -------
        list of Jet
            In the order of the function's results; the jets' directions are the last axis of the slopes.
        """
        m = next(x.slope.shape[-1] for x in (*given.values(), *seeds.values()) if isinstance(x, Jet))
        f = self.functions[name]
        k = len(value_of(next(iter(seeds.values()))))
        zeros = {s: np.zeros(k) if s == "dt" else np.zeros((k, n)) for s, n in f.seeds.items()}
        taken = [*(given[a] for a in f.arguments), *(seeds.get(s, zeros[s]) for s in f.seeds)]
        with np.errstate(all="ignore"):  # the NumPy target ignores these warnings, too
            found = getattr(self.module, name)(*taken)
        return [x if x.slope.shape[-1] else Jet(x.value, np.zeros((*x.value.shape, m))) for x in found]


def _call_of_jets(plain: Any) -> Any:
    """The module's class of calls, for arguments that may be jets."""

    class Call(plain):
        def __init__(self, **given: Any):
            super().__init__(**{name: value_of(x) for name, x in given.items()})
            for name, x in given.items():
                if isinstance(x, Jet):
                    setattr(self, name, self._of_rows(name, x.slope))

        def _of_rows(self, name: str, slope: Array) -> Jet:
            """A jet with the axes: components, directions of seeds, batch; see ``Call`` of the module."""
            slope = slope[..., None, :] if name in ("t", "dt") else slope
            if name.startswith("d"):
                missing = len(self.batch) - (slope.ndim - 3)
                slope = slope.reshape(slope.shape[:1] + (1,) * missing + slope.shape[1:])
            return Jet(getattr(self, name), np.moveaxis(slope, -2, 0))

    return Call


def _result_of_jets(plain: Any) -> Any:
    """The module's function that assembles results, for rows that may be jets."""

    def result(rows: Sequence[Any], shape: Shape) -> Any:
        slopes = [x.slope for x in rows if isinstance(x, Jet)]
        m = slopes[0].shape[-1] if slopes else 0
        slope = np.zeros((*shape, len(rows), m))
        for i, row in enumerate(rows):
            if isinstance(row, Jet):
                slope[..., i, :] = row.slope
        return Jet(plain([value_of(x) for x in rows], shape), slope)

    return result
