"""Pictures of states and animations of motions of a solver that has frames."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array, Numbers, Times
from ..calls.package import state
from ..calls.room import Room, alone
from ..trajectory.trajectory import Trajectory
from .picture import animate, draw
from .poses import Poses
from .scene import Scene, scene_of


class Views(Room):
    """Pictures of states, and animations of motions."""

    def picture(
        self, q: Numbers, p: Numbers, inputs: Numbers, t: Times, path: str | os.PathLike[str] | None, view: str,
        folder: str | os.PathLike[str],
    ) -> Any:  # fmt: skip
        """See `Solver.picture`."""
        arrays, batch = self._arguments.take(state(q, np.zeros(self.nu), p, inputs, t), self._left_out)
        alone(batch)
        scene = self._scene(arrays["p"])
        poses = self._poses(arrays["q"][None], arrays["p"], arrays["inputs"], np.atleast_1d(arrays["t"]))
        return draw(scene, poses, path, view, Path(folder))

    def of_motion(self, run: Trajectory) -> MotionViews:
        """What shows a trajectory that was loaded from a file.

        Raises
        ------
        ValueError
            If prescribed motion follows inputs, which a trajectory contains only if they are constant.
        """
        if run.inputs is None and self.moving_inputs:
            raise ValueError(
                f"prescribed motion of {self.name} follows inputs over time, which the trajectory does not contain; simulate "
                f"again and animate the result"
            )
        constant = np.zeros(len(self.signal_names)) if run.inputs is None else run.inputs
        return MotionViews(self, lambda: self._all_inputs(constant))

    def _all_inputs(self, constant: Array) -> Array:
        """Constant signals with their time derivatives, which are zero."""
        every = np.zeros(self.ninputs)
        every[: len(constant)] = constant
        return every

    def _scene(self, p: Array) -> Scene:
        """The scene at parameters.

        Raises
        ------
        AttributeError
            The package was generated without frames.
        """
        if "display" not in self._manifest:
            raise AttributeError(self._why_not("picture"))
        return scene_of(self._manifest, p)

    def _poses(self, q: Array, p: Array, inputs: Array, t: Array) -> Poses:
        found = self._call("frames", (q, np.zeros(self.nu), p, inputs, t))[0]
        return Poses(t, found[..., :9].reshape(*found.shape[:-1], 3, 3), found[..., 9:12])


class MotionViews:
    """Animations of a motion.

    Parameters
    ----------
    views : Views
        Those of the solver of the motion.
    inputs : callable
        Returns the inputs at the times of the motion, (nt, ninputs) or (ninputs,).
    """

    def __init__(self, views: Views, inputs: Callable[[], Array]):
        self.views, self.inputs = views, inputs

    def animate(
        self, run: Trajectory, path: str | os.PathLike[str], view: str, folder: str | os.PathLike[str], rate: float
    ) -> None:
        """See `Trajectory.animate`."""
        scene, poses = self.shown(run)
        animate(scene, poses, path, view, Path(folder), rate)

    def shown(self, run: Trajectory) -> tuple[Scene, Poses]:
        """The scene of a motion and its poses over time."""
        if not len(run):
            raise ValueError(f"the trajectory of {run.model} has no times, so there is nothing to show")
        p = self.views.package.parameters if run.p is None else run.p
        return self.views._scene(p), self.views._poses(run.q, p, self.inputs(), run.t)
