"""What joints and loops transmit, of bodies, from the wrenches of links that the generated code gives."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..arrays import Array, Indices

JointLinks = tuple[Indices | None, Indices]
"""The link of each body's joint, None where these are all links in order; and the bodies on fixed joints."""


def joint_links(manifest: Mapping[str, Any]) -> JointLinks:
    """Where the joints of a model's bodies are among its links."""
    links = np.array(manifest["joint_links"], dtype=int)
    every = np.array_equal(links, np.arange(len(manifest["links"])))
    return None if every else links, np.flatnonzero(links < 0)


def reactions_of(of: JointLinks, found: Sequence[Array]) -> tuple[Array, Array]:
    """Those of joints and of loops."""
    joints, *loops = found
    return _of_joints(of, joints), loops[0] if loops else joints[..., :0, :]


def reaction_sensitivities_of(of: JointLinks, found: Sequence[Array]) -> tuple[Array, Array, Array, Array]:
    """The same with their derivatives."""
    if len(found) == 4:
        joints, loops, djoints, dloops = found
    else:
        joints, djoints = found
        loops, dloops = joints[..., :0, :], djoints[..., :0, :]
    return _of_joints(of, joints), loops, _of_joints(of, djoints), dloops


def _of_joints(of: JointLinks, wrenches: Array) -> Array:
    """Those of the joints of bodies, from those of links."""
    of_bodies, fixed = of
    if of_bodies is None:
        return wrenches
    joints: Array = wrenches.take(of_bodies, axis=-2)
    if len(fixed):
        joints[..., fixed, :] = math.nan
    return joints
