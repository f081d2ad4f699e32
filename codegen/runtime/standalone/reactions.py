"""What joints and loops transmit."""

from __future__ import annotations

import math

import numpy as np

from .arrays import Array, Numbers, Times
from .package import Package, state


class Reactions(Package):
    """What joints and loops transmit."""

    def reactions(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0
    ) -> tuple[Array, Array]:
        """What joints and loops transmit, in the ground frame: moment, N m, then force, N.

        Needs a package that was generated with reactions.

        Returns
        -------
        joints : (..., nbodies, 6)
            What the joint of each body does to it, about the body's origin, the joint's own force included. NaN for a body on a
            fixed joint: it is one with what carries it.
        loops : (..., nloops, 6)
            What each loop joint does to its ``to`` body, about the origin of the face there. Where conditions are redundant
            they are not unique: these are, ear by ear, the ones with the least sum of squares of moments, and forces
            times the characteristic length.
        """
        found = self._values("reactions", state(q, u, p, inputs, t))
        batch = found[0].shape[:-1]
        links, *loops = (x.reshape(*batch, x.shape[-1] // 6, 6) for x in found)
        of_bodies: list[int] = self._manifest["joint_links"]
        joints = np.full((*batch, len(of_bodies), 6), math.nan)
        for body, link in enumerate(of_bodies):
            if link >= 0:
                joints[..., body, :] = links[..., link, :]
        return joints, loops[0] if loops else np.zeros((*batch, 0, 6))
