"""Pictures of states and animations of motions of a solver that has frames."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array, Numbers, Times
from ..calls.package import state
from ..calls.room import Room, alone
from ..state.reactions import joint_links, reactions_of
from ..trajectory.trajectory import Trajectory
from ..warning import warn
from .controls import MOST_SLIDERS, Playback, Sliders, add_choices, around
from .forces import AppliedForces, arrows_of
from .picture import animate, draw
from .poses import Arrows, Poses, places_of
from .scene import Scene, scene_of
from .viewer import Viewer

MOST_RESULTS = 10_000
"""Number of results of a motion above which some are left out."""


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
        poses = self._poses(
            arrays["q"][None], np.zeros(self.nu), arrays["p"], arrays["inputs"], np.atleast_1d(arrays["t"])
        )
        return draw(scene, poses, path, view, Path(folder))

    def view(
        self, q: Numbers, u: Numbers, p: Numbers, inputs: Numbers, t: Times, folder: str | os.PathLike[str], port: int,
        arrows: str | Sequence[str],
    ) -> Viewer:  # fmt: skip
        """See `Solver.view`."""
        arrays, batch = self._arguments.take(state(q, u, p, inputs, t), self._left_out)
        alone(batch)
        return StateView(self, arrays, Path(folder), port, arrows).viewer

    def of_motion(self, run: Trajectory) -> MotionViews:
        """The views of a trajectory that was loaded from a file.

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

    def _poses(self, q: Array, u: Array, p: Array, inputs: Array, t: Array) -> Poses:
        found = self._call("frames", (q, u, p, inputs, t))[0]
        return Poses(t, found[..., :9].reshape(*found.shape[:-1], 3, 3), found[..., 9:12], twist=found[..., 12:])

    def _shades(
        self, scene: Scene, q: Array, p: Array, inputs: Array, t: Array, dq: Array, names: Sequence[str]
    ) -> dict[str, Array]:
        """Displacements of centres of mass per unit of each quantity in `names`; dq (k, nt, nq) are the derivatives of q."""
        dp = np.zeros((len(names), 1, self.np))
        for k, name in enumerate(names):
            if name in self.parameter_names:
                dp[k, 0, self.parameter_names.index(name)] = 1.0
        given, along = (q, np.zeros(self.nu), p, inputs, t), (dq, None, dp, None, None)
        tangents = self._call("frame_sensitivities", given, along)[1]
        turned = tangents[..., :9].reshape(*tangents.shape[:-1], 3, 3) @ np.stack(scene.centres)[:, :, None]
        moved = np.linalg.norm(tangents[..., 9:12] + turned[..., 0], axis=-1)
        return dict(zip(names, moved, strict=True))

    def _arrows(self, q: Array, u: Array, p: Array, inputs: Array, scene: Scene, poses: Poses) -> dict[str, Arrows]:
        """Arrows of reactions, if the package has them, and of the forces of force elements."""
        applied = AppliedForces(self._manifest, scene, p, inputs, q, u, poses).found()
        if "reactions" not in self._functions:
            return applied
        joints, loops = reactions_of(joint_links(self._manifest), self._call("reactions", (q, u, p, inputs, poses.t)))
        found = [(poses.position, joints[..., 3:])]
        faces = [i for i, loop in enumerate(self._manifest["loops"]) if loop not in self._manifest.get("couplings", ())]
        if faces:
            ends = np.stack([places_of(scene.loops[1::2], poses, i) for i in range(len(poses.t))])
            found.append((ends, loops[:, faces, 3:]))
        return {"reactions": arrows_of(found, poses), **applied}


class MotionViews:
    """Animations of a motion.

    Parameters
    ----------
    views : Views
        Views of the solver that computed the motion.
    inputs : callable
        Returns the inputs at the times of the motion, (nt, ninputs) or (ninputs,).

    Attributes
    ----------
    again : callable or None
        Returns the motion at other parameters.
    """

    def __init__(self, views: Views, inputs: Callable[[], Array]):
        self.views, self.inputs = views, inputs
        self.again: Callable[[Array], Trajectory] | None = None

    def animate(
        self, run: Trajectory, path: str | os.PathLike[str], view: str, folder: str | os.PathLike[str], rate: float
    ) -> None:
        """See `Trajectory.animate`."""
        scene, poses = self.shown(run)
        animate(scene, poses, path, view, Path(folder), rate)

    def view(self, run: Trajectory, folder: str | os.PathLike[str], port: int, arrows: str | Sequence[str]) -> Viewer:
        """See `Trajectory.view`."""
        scene, poses = self.shown(run)
        viewer = Viewer(run.model, scene, poses, Path(folder), port, arrows)
        if len(poses.t) > 1:
            Playback(viewer)
        add_choices(viewer)
        if self.again is not None and run.p is not None and len(run.p):
            package = self.views.package
            units = self.views._manifest.get("parameter_units", [""] * package.np)

            def changed(p: Array) -> None:
                assert self.again is not None
                other = self.again(p)
                viewer.replace(*other.views.shown(other))

            Sliders(viewer, "design", package.parameter_names, units, run.p, *around(run.p), changed)
        return viewer

    def html(
        self, run: Trajectory, path: str | os.PathLike[str], folder: str | os.PathLike[str], arrows: str | Sequence[str]
    ) -> None:
        """See `Trajectory.html`."""
        viewer = Viewer(run.model, *self.shown(run), Path(folder), 0, arrows)
        try:
            viewer.html(path)
        finally:
            viewer.close()

    def shown(self, run: Trajectory) -> tuple[Scene, Poses]:
        """The scene of a motion and its poses over time, with the reactions and derivatives that are available."""
        if not len(run):
            raise ValueError(f"the trajectory of {run.model} has no times, so there is nothing to show")
        p = self.views.package.parameters if run.p is None else run.p
        views, inputs, rows = self.views, self.inputs(), _thinned(len(run))
        inputs = inputs[rows] if inputs.ndim == 2 else inputs
        t, q, u = run.t[rows], run.q[rows], run.u[rows]
        scene, poses = views._scene(p), views._poses(q, u, p, inputs, t)
        by_inputs = [n.startswith("inputs.") and bool(views.moving_inputs) for n in run.sensitivity_names]
        # dq lacks the effect of inputs on prescribed joints
        kept = [k for k, moves in enumerate(by_inputs) if not moves]
        names = [run.sensitivity_names[k] for k in kept]
        shades = views._shades(scene, q, p, inputs, t, run.dq[kept][:, rows], names) if names else {}
        return scene, replace(poses, shades=shades, arrows=views._arrows(q, u, p, inputs, scene, poses))


def _thinned(count: int) -> Any:
    """Indices of the results that are shown: all, or `MOST_RESULTS` of them at equal intervals, with a
    warning."""
    if count <= MOST_RESULTS:
        return slice(None)
    warn(f"the motion has {count} results; {MOST_RESULTS} of them are shown")
    return np.linspace(0, count - 1, MOST_RESULTS).round().astype(int)


def single_coordinates(package: Any, quaternions: Sequence[int]) -> list[str]:
    """Independent coordinates that a slider may change alone: all but the components of quaternions, whose first
    components have the given indices."""
    components = {package.coordinate_names[i + k] for i in quaternions for k in range(4)}
    return [n for n in package.independent_names if n not in components]


class StateView:
    """A view of one state with sliders for independent coordinates and design parameters; loops stay closed.

    Parameters
    ----------
    views : Views
    arrays : dict of str to ndarray
        The state.
    folder : Path
        Folder that names of mesh files start from.
    port : int
        See `Viewer`.
    arrows : str or sequence of str
        See `Viewer`.
    """

    def __init__(self, views: Views, arrays: dict[str, Any], folder: Path, port: int, arrows: str | Sequence[str]):
        self.views, self.arrays = views, arrays
        package: Any = views.package
        self.viewer = Viewer(package.name, *self._shown(), folder, port, arrows)
        add_choices(self.viewer)
        names = single_coordinates(package, views._manifest["quaternions"])
        self.places = [package.coordinate_names.index(n) for n in names]
        units = [views._manifest["coordinate_units"][i] for i in self.places]
        values = arrays["q"][self.places]
        half = np.array([np.pi if unit == "rad" else self.viewer.size / 2 for unit in units])
        if names:
            Sliders(self.viewer, "coordinates", names, units, values, values - half, values + half, self._moved)
        if package.np:
            p, units = arrays["p"], views._manifest.get("parameter_units", [""] * package.np)
            Sliders(self.viewer, "design", package.parameter_names, units, p, *around(p), self._changed)

    def _shown(self) -> tuple[Scene, Poses]:
        """The scene and its pose, with reactions, and with displacements per unit of each parameter while loops stay closed."""
        x, views = self.arrays, self.views
        package: Any = views.package
        q, t = x["q"][None], np.atleast_1d(x["t"])
        scene, poses = views._scene(x["p"]), views._poses(q, x["u"][None], x["p"], x["inputs"], t)
        names = package.parameter_names[:MOST_SLIDERS]
        dp = np.eye(package.np)[: len(names)]
        dq = package.assemble_sensitivities(x["q"], x["u"], x["p"], x["inputs"], x["t"], dp=dp)[2] if names else None
        shades = {} if dq is None else views._shades(scene, q, x["p"], x["inputs"], t, dq[:, None], names)
        return scene, replace(
            poses, shades=shades, arrows=views._arrows(q, x["u"][None], x["p"], x["inputs"], scene, poses)
        )

    def _moved(self, values: Array) -> None:
        """Close the loops at other independent coordinates, and show the state."""
        q = self.arrays["q"].copy()
        q[self.places] = values
        self._close({**self.arrays, "q": q})
        self.viewer.move(self._shown()[1])

    def _changed(self, p: Array) -> None:
        """Close the loops at other parameters, and show the state."""
        self._close({**self.arrays, "p": p})
        self.viewer.replace(*self._shown())

    def _close(self, arrays: dict[str, Any]) -> None:
        package: Any = self.views.package
        q, u = package.assemble(arrays["q"], arrays["u"], arrays["p"], arrays["inputs"], arrays["t"])
        self.arrays = {**arrays, "q": q, "u": u}
