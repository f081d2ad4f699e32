"""Partitions into independent and dependent coordinates in a package, and their condition numbers at a state."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..arrays import Array, Numbers, Times
from ..calls.arguments import placed, placing
from ..calls.package import Package
from ..calls.targets import partitions_of
from ..errors import SingularLoopError


def partition_names(package: Package) -> tuple[tuple[str, ...], ...]:
    """See `Solver.partitions`."""
    return tuple(tuple(m.get("independent_names", package.coordinate_names)) for m in partitions_of(package._manifest))


def use_partition(package: Package, partition: int) -> None:
    """See `Solver.use_partition`."""
    count = len(partitions_of(package._manifest))
    if isinstance(partition, bool) or not isinstance(partition, (int, np.integer)):
        raise ValueError(f"partition is {partition!r}, expected an integer below {count}")
    if not 0 <= partition < count:
        raise ValueError(f"partition is {partition}, expected 0 to {count - 1}")
    package._use(package._open(int(partition)))


def conditions(package: Package, q: Numbers, p: Numbers, inputs: Numbers, t: Times) -> Array:
    """See `Solver.condition`."""
    arrays, batch = package._arguments.take({"q": q, "p": p, "inputs": inputs, "t": t}, package._left_out)
    found = np.ones((*batch, len(partitions_of(package._manifest))))
    if not package.closure_names:
        return found
    q_all = np.broadcast_to(arrays["q"], (*batch, package.nq))
    p_all = placing(arrays, batch, package._opened.manifest)
    for k in range(found.shape[-1]):
        opened = package._open(k)
        for at in np.ndindex(batch):
            given = placed(q_all[at].copy(), p_all[at].copy(), package.np)
            try:
                (values,) = opened.target.compute(opened.functions["conditions"], given, ())
                found[(*at, k)] = values.max(initial=1.0)
            except SingularLoopError:
                found[(*at, k)] = math.inf
    return found


def scale_of(manifest: Mapping[str, Any]) -> Array:
    """Unit of change of each coordinate (nq,): 1 rad, 0.5 of a quaternion component, or a characteristic length."""
    length = max((float(c["length"]) for c in manifest.get("closures", ())), default=1.0) or 1.0
    scale = np.array([length if unit == "m" else 1.0 for unit in manifest["coordinate_units"]])
    for i in manifest["quaternions"]:
        scale[i : i + 4] = 0.5
    return scale
