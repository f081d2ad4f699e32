"""Wrenches that joints and loops transmit, one for each body, from the wrenches for each link that generated code computes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..arrays import Array, Indices

JointLinks = tuple[Indices | None, Indices]
"""The link of each body's joint (None if links and bodies coincide), and the bodies on fixed joints."""


def joint_links(manifest: Mapping[str, Any]) -> JointLinks:
    """The links of the bodies' joints, from the manifest of a package."""
    links = np.array(manifest["joint_links"], dtype=int)
    every = np.array_equal(links, np.arange(len(manifest["links"])))
    return None if every else links, np.flatnonzero(links < 0)


def reactions_of(of: JointLinks, found: Sequence[Array]) -> tuple[Array, Array]:
    """Wrenches of joints and of loops."""
    joints, *loops = found
    return _of_joints(of, joints), loops[0] if loops else joints[..., :0, :]


def reaction_sensitivities_of(of: JointLinks, found: Sequence[Array]) -> tuple[Array, Array, Array, Array]:
    """Wrenches of joints and of loops, and their derivatives."""
    if len(found) == 4:
        joints, loops, djoints, dloops = found
    else:
        joints, djoints = found
        loops, dloops = joints[..., :0, :], djoints[..., :0, :]
    return _of_joints(of, joints), loops, _of_joints(of, djoints), dloops


def _of_joints(of: JointLinks, wrenches: Array) -> Array:
    """A wrench for each body, from those for each link; NaN for fixed joints."""
    of_bodies, fixed = of
    if of_bodies is None:
        return wrenches
    joints: Array = wrenches.take(of_bodies, axis=-2)
    if len(fixed):
        joints[..., fixed, :] = math.nan
    return joints
