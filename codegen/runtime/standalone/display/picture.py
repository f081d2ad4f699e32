"""Pictures and animations of a mechanism by matplotlib, which needs no window and no browser.

The same scene and poses give the same bytes.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array
from ..files.whole_file import MARK, suffix_among, write_whole
from ..trajectory.plot import COLOURS, FORMATS, SETTINGS, PlotError, need, png_of
from ..warning import warn
from .meshes import Meshes
from .poses import Poses, ends_of, places_of
from .scene import SAME, Axis, Scene, Solid

ANIMATIONS = (".gif", ".png")
"""Formats of animations; PNG is animated PNG."""

MOST_FRAMES = 600
"""Number of frames of an animation above which frames are left out."""

LIGHT = np.array([0.35, -0.5, 0.8]) / np.linalg.norm([0.35, -0.5, 0.8])
"""Direction towards the light, in the ground frame."""

LINES = {"sticks": ("#333333", 2.5), "rails": ("#999999", 1.0), "elements": ("#009e73", 1.2)}
MARKS = {"joints": ("#000000", 10), "loops": ("#d55e00", 22), "points": ("#aa4499", 10)}
"""Colours and widths of lines, and colours and sizes of points, by their lists in `Scene`."""

SOLID_COLORS = COLOURS[1:3] + COLOURS[4:6] + COLOURS[7:8]
"""Colours, used in turn, for bodies without a colour in the model."""


def draw(scene: Scene, poses: Poses, path: str | os.PathLike[str] | None, view: str, folder: Path) -> Any:
    """A figure of the scene at the first of the poses; see `Solver.picture`."""
    formats = f"pictures are written as {', '.join(FORMATS)}"
    suffix = None if path is None else suffix_among(path, FORMATS, PlotError, formats)
    matplotlib = need()
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(SETTINGS)
        figure = _Figure(scene, poses, view, folder)
        figure.show(0)
        if path is not None and suffix is not None:
            write_whole(
                Path(path), lambda file: figure.figure.savefig(file, format=suffix[1:], metadata=FORMATS[suffix])
            )
    figure.figure._repr_png_ = functools.partial(png_of, figure.figure)
    return figure.figure


def animate(scene: Scene, poses: Poses, path: str | os.PathLike[str], view: str, folder: Path, rate: float) -> None:
    """Write an animation of the scene through its poses; see `Trajectory.animate`."""
    suffix_among(path, dict.fromkeys(ANIMATIONS), PlotError, f"animations are written as {' or '.join(ANIMATIONS)}")
    if not 0.0 < rate < float("inf"):
        raise PlotError(f"rate is {rate}; a positive number of frames per second is needed")
    matplotlib = need()
    chosen = _frames(poses.t, rate)
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(SETTINGS)
        figure = _Figure(scene, poses, view, folder)
        images = list(_images(figure, chosen))
    from PIL.PngImagePlugin import PngInfo

    kind = "GIF" if Path(path).suffix.lower() == ".gif" else "PNG"
    mark = PngInfo()
    mark.add_text("Software", MARK)
    options: dict[str, Any] = {"disposal": 2, "comment": MARK.encode()} if kind == "GIF" else {"pnginfo": mark}
    options |= {"save_all": True, "append_images": images[1:], "duration": 1000.0 / rate, "loop": 0}
    write_whole(Path(path), lambda file: images[0].save(file, kind, **options))


def _frames(t: Array, rate: float) -> Array:
    """Indices of the results nearest in time to the frames; `rate` is the number of frames per second."""
    count = int((t[-1] - t[0]) * rate) + 1 if len(t) > 1 else 1
    if count > MOST_FRAMES:
        warn(f"{count} frames are too many for an animation; every {count / MOST_FRAMES:.3g}th of them is shown")
    wanted = np.linspace(t[0], t[-1], min(count, MOST_FRAMES))
    after = np.clip(np.searchsorted(t, wanted), 1, max(len(t) - 1, 1))
    before = after - 1
    return np.asarray(np.where(wanted - t[before] <= t[np.minimum(after, len(t) - 1)] - wanted, before, after))


def _images(figure: _Figure, chosen: Array) -> Iterator[Any]:
    from PIL import Image

    for i in chosen.tolist():
        figure.show(i)
        figure.canvas.draw()
        size, pixels = figure.canvas.get_width_height(), figure.canvas.buffer_rgba().tobytes()
        yield Image.frombuffer("RGBA", size, pixels).convert("RGB")


class _Figure:
    """The axes of a picture, in which the scene is drawn at successive times."""

    def __init__(self, scene: Scene, poses: Poses, view: str, folder: Path):
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        self.scene, self.poses = scene, poses
        meshes = Meshes(folder)
        self.surfaces = [
            (s, s.placed(vertices), faces) for s in scene.solids for vertices, faces in [meshes.surface(s)]
        ]
        self.figure: Any = Figure(figsize=(6.0, 5.0))
        self.canvas = FigureCanvasAgg(self.figure)
        self.axes: Any = self.figure.add_axes((0, 0, 1, 1), projection="3d", proj_type="ortho", computed_zorder=False)
        self.view = view_of(view, scene, poses)
        points = self._points()
        low, high = points.min(axis=0), points.max(axis=0)
        self.middle, self.half = (low + high) / 2, 0.5 * (float((high - low).max()) or 1.0)
        self._look()
        self.half *= self._extent(points) / 0.9

    def _look(self) -> None:
        """Sets the direction of the view and the limits of the axes."""
        axes = self.axes
        axes.view_init(*self.view)
        for k, set_limits in enumerate((axes.set_xlim, axes.set_ylim, axes.set_zlim)):
            set_limits(self.middle[k] - self.half, self.middle[k] + self.half)
        axes.set_box_aspect((1, 1, 1))

    def _extent(self, points: Array) -> float:
        """Largest distance of points from the middle of the picture, relative to half of its width."""
        from mpl_toolkits.mplot3d.proj3d import proj_transform

        self.axes.apply_aspect()
        x, y, _ = proj_transform(*points.T, self.axes.get_proj())
        places = self.axes.transData.transform(np.column_stack([x, y]))
        window = self.axes.bbox
        middle, half = (window.p0 + window.p1) / 2, (window.p1 - window.p0) / 2
        return float(np.abs((places - middle) / half).max())

    def _points(self) -> Array:
        """Positions (n, 3), in m, of all points of the scene at some times of the motion."""
        poses = self.poses
        steps = np.unique(np.linspace(0, len(poses.t) - 1, 60).astype(int))
        found = [poses.of(s.body, v, i) for i in steps for s, v, _ in self.surfaces]
        for i in steps:
            found += [ends_of(self.scene.lines(kind), poses, i).reshape(-1, 3) for kind in LINES]
            found += [places_of(self.scene.marks(kind), poses, i) for kind in MARKS]
        every = np.concatenate(found)
        return every if len(every) else poses.position[0]

    def show(self, i: int) -> None:
        """Draw the scene at time i."""
        from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

        axes, poses, scene = self.axes, self.poses, self.scene
        axes.clear()
        axes.set_axis_off()
        self._look()
        triangles, colors = [], []
        for solid, vertices, faces in self.surfaces:
            corners = poses.of(solid.body, vertices, i)[faces]
            triangles.append(corners)
            colors.append(_shaded(solid, corners))
        if triangles:
            every = Poly3DCollection(np.concatenate(triangles), linewidths=0)
            every.set_facecolor(np.concatenate(colors))
            axes.add_collection3d(every)
        for kind, (colour, width) in LINES.items():
            if lines := scene.lines(kind):
                axes.add_collection3d(Line3DCollection(ends_of(lines, poses, i), colors=colour, linewidths=width))
        for kind, (colour, size) in MARKS.items():
            if marks := scene.marks(kind):
                axes.scatter(*places_of(marks, poses, i).T, s=size, c=colour, depthshade=False)
        if len(poses.t) > 1:
            axes.text2D(0.02, 0.02, f"t = {poses.t[i]:.2f} s", transform=axes.transAxes, fontsize=9)


def _shaded(solid: Solid, corners: Array) -> Array:
    """Colours (n, 4) of triangles (n, 3, 3) by their angle to the light."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    bright = 0.55 + 0.45 * np.abs(normal / np.where(length > 0.0, length, 1.0) @ LIGHT)
    base = solid.color or SOLID_COLORS[solid.body % len(SOLID_COLORS)]
    numbers = [int(base[k : k + 2], 16) / 255.0 for k in range(1, len(base), 2)]
    alpha = numbers[3] if len(numbers) == 4 else 1.0
    return np.column_stack([bright[:, None] * np.array(numbers[:3]), np.full(len(bright), alpha)])


VIEWS = {"x": (0.0, 0.0), "y": (0.0, -90.0), "z": (90.0, -90.0), "corner": (22.0, -58.0)}
"""Elevation and azimuth, degrees, of views along each axis of the ground, and from a corner."""


def view_of(view: str, scene: Scene, poses: Poses) -> tuple[float, float]:
    """Elevation and azimuth of a view. "auto" looks along the normal of a planar mechanism if this normal is an axis of
    the ground.

    Raises
    ------
    ValueError
        If there is no view of that name.
    """
    if view in VIEWS:
        return VIEWS[view]
    if view != "auto":
        raise ValueError(f"view is {view!r}; {', '.join(VIEWS)} and auto are allowed")
    for k, name in enumerate("xyz"):
        if all(_keeps_plane(axis, np.eye(3)[k], poses) for axis in scene.axes.values()):
            return VIEWS[name]
    return VIEWS["corner"]


def _keeps_plane(axis: Axis, normal: Array, poses: Poses) -> bool:
    """Whether a joint moves bodies only in the plane with a normal."""
    if axis.type not in ("revolute", "prismatic", "planar"):
        return False
    along = abs(float((poses.of(axis.body, axis.direction, 0) - poses.of(axis.body, np.zeros(3), 0)) @ normal))
    return along < SAME if axis.type == "prismatic" else along > 1.0 - SAME
