"""What joints and loops transmit."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence

import numpy as np

from ..arrays import Array, Indices, Numbers, Times
from ..calls.package import Package


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
        joints, *loops = self._call("reactions", (q, u, p, inputs, t))
        return self._of_joints(joints), _of_loops(loops, joints)

    def reaction_sensitivities(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None,
    ) -> tuple[Array, Array, Array, Array]:  # fmt: skip
        """`reactions` and their total derivatives along the seeds.

        Through closed loops seeds of dependent coordinates and speeds follow from the others. Where conditions are
        redundant it is the derivative of the reactions that `reactions` gives.

        Returns
        -------
        joints : (..., nbodies, 6)
        loops : (..., nloops, 6)
        djoints : (k, ..., nbodies, 6)
            Of the components in the ground frame, N m and N per unit of the seed. NaN where `joints` is.
        dloops : (k, ..., nloops, 6)
        """
        along = (dq, du, dp, dinputs, dt)
        found = self._call("reaction_sensitivities", (q, u, p, inputs, t), along)
        if len(found) == 2:
            joints, djoints = found
            loops, dloops = joints[..., :0, :], djoints[..., :0, :]
        else:
            joints, loops, djoints, dloops = found
        return self._of_joints(joints), loops, self._of_joints(djoints), dloops

    @functools.cached_property
    def _joint_links(self) -> tuple[Indices | None, Indices]:
        """The link of each body's joint, None where these are all links in order; and the bodies on fixed joints."""
        links = np.array(self._manifest["joint_links"], dtype=int)
        every = np.array_equal(links, np.arange(len(self._manifest["links"])))
        return None if every else links, np.flatnonzero(links < 0)

    def _of_joints(self, wrenches: Array) -> Array:
        """Those of the joints of bodies, from those of links."""
        of_bodies, fixed = self._joint_links
        if of_bodies is None:
            return wrenches
        joints: Array = wrenches.take(of_bodies, axis=-2)
        if len(fixed):
            joints[..., fixed, :] = math.nan
        return joints


def _of_loops(wrenches: Sequence[Array], like: Array) -> Array:
    """Those of loops; none, of as many states, where there are no loops."""
    return wrenches[0] if wrenches else like[..., :0, :]
