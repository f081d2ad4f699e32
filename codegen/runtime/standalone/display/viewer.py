"""A view of a mechanism in a browser, by viser; and pages that play without a server."""

from __future__ import annotations

import contextlib
import math
import os
import socket
import threading
import time
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array, Indices
from ..files.whole_file import MARK, suffix_among, write_whole
from ..warning import warn
from .forces import KINDS
from .meshes import Meshes
from .picture import LINES, MARKS, SOLID_COLORS
from .poses import Arrows, Poses, ends_of, groups_of, places_of, quaternions
from .scene import Mark, Scene
from .surfaces import MANY, Surface

RATE = 30.0
"""Frames per second of playback, and of a page."""

MOST_FRAMES = 3000
"""Number of frames of a page or a playback above which frames are left out."""


SLOWER = (
    "<script>{const every = setInterval; "
    f"setInterval = (f, ms, ...given) => every(f, Math.max(ms, {1000 / RATE:.1f}), ...given)}}</script>"
)
"""Script at the start of a page. Without it, viser moves its time bar 120 times a second, although poses change at `RATE`,
and a computer without a graphics card spends more time on the bar than on the mechanism."""

LARGEST_PORT = 65535


def need() -> Any:
    """The module viser.

    Raises
    ------
    ImportError
        If it is not installed.
    """
    try:
        import viser
    except ImportError as error:
        raise ImportError('views need viser: pip install "ordernm[view]", or pip install viser') from error
    return viser


class Nodes:
    """The nodes of a scene in a viser server.

    Parameters
    ----------
    server : viser.ViserServer
    scene : Scene
    meshes : Meshes
    size : float
        Length of the diagonal of the mechanism, m; points and lines are drawn in proportion.
    """

    def __init__(self, server: Any, scene: Scene, meshes: Meshes, size: float):
        self.server, self.scene = server, scene
        self.groups = groups_of(scene.solids, meshes)
        self.lines = [kind for kind in LINES if scene.lines(kind)]
        self.marks = [kind for kind in MARKS if scene.marks(kind)]
        self.size = size
        self.handles: dict[str, Any] = {}

    def show(self, poses: Poses, i: int, shade: str = "", arrows: Collection[str] = ()) -> None:
        """Shows the scene at time i with some kinds of arrows; the parameter `shade`, if given, colours the bodies."""
        shown = poses.shades.get(shade)
        colors = None if shown is None else _scale(shown[i] / (float(np.nanmax(shown, initial=0.0)) or 1.0))
        with self.server.atomic():
            for kind in KINDS:
                self._arrows(kind, poses.arrows.get(kind) if kind in arrows else None, i)
            for k, group in enumerate(self.groups):
                turns = quaternions(poses.turned(group.bodies, group.rotation, i))
                places = poses.many(group.bodies, group.at, i)
                own = colors_of(group.bodies, group.color) if colors is None else colors[group.bodies]
                self._meshes(f"/solids/{k}", group.vertices, group.faces, turns, places, own)
            for kind in self.lines:
                self._lines(kind, ends_of(self.scene.lines(kind), poses, i))
            for kind in self.marks:
                self._marks(kind, places_of(self.scene.marks(kind), poses, i))

    def _marks(self, kind: str, places: Array) -> None:
        """Draws marks as octahedra. If there are many, draws them as discs smaller than links, since a browser without a
        graphics card draws octahedra one by one."""
        colour, radius = _rgb(MARKS[kind][0]), self.size * MARKS[kind][1] ** 0.5 * 1.6e-3
        if len(places) <= MANY:
            turns = np.tile([1.0, 0.0, 0.0, 0.0], (len(places), 1))
            self._meshes(f"/{kind}", *_octahedron(radius), turns, places, np.tile(colour, (len(places), 1)))
        elif kind in self.handles:
            _send(self.handles[kind], points=places)
        else:
            radius = min(radius, 0.1 * _link_length(self.scene.marks(kind)))
            self.handles[kind] = self.server.scene.add_point_cloud(
                f"/{kind}", places, colour, point_size=2 * radius, point_shape="circle", precision="float32"
            )

    def _meshes(self, name: str, vertices: Array, faces: Indices, turns: Array, places: Array, colors: Array) -> None:
        known = self.handles.get(name)
        if known is None:
            self.handles[name] = self.server.scene.add_batched_meshes_simple(
                name, vertices.astype(np.float32), faces.astype(np.uint32), turns, places, batched_colors=colors,
                flat_shading=len(vertices) < 10, lod="off", cast_shadow=False, receive_shadow=False,
            )  # fmt: skip
        else:
            _send(known, batched_wxyzs=turns, batched_positions=places, batched_colors=colors)

    def _lines(self, kind: str, ends: Array) -> None:
        if kind in self.handles:
            _send(self.handles[kind], points=ends)
        else:
            colour, width = LINES[kind]
            thickness = self.size * width * 1.5e-3
            self.handles[kind] = self.server.scene.add_line_segments(
                f"/{kind}", ends, _rgb(colour), thickness=thickness
            )

    def _arrows(self, kind: str, arrows: Arrows | None, i: int) -> None:
        """Arrows of a kind at time i, or None; the longest of the motion is a quarter of the mechanism's size."""
        if arrows is None or not (largest := arrows.largest):
            if (known := self.handles.pop(kind, None)) is not None:
                known.remove()
            return
        places = arrows.places[i]
        ends = np.stack([places, places + arrows.vectors[i] * (0.25 * self.size / largest)], axis=1)
        if kind in self.handles:
            _send(self.handles[kind], points=ends)
        else:
            self.handles[kind] = self.server.scene.add_arrows(
                f"/{kind}", ends, _rgb(KINDS[kind]), shaft_radius=0.003 * self.size,
                head_radius=0.008 * self.size, head_length=0.02 * self.size,
            )  # fmt: skip

    def remove(self) -> None:
        """Take all nodes out of the view."""
        for handle in self.handles.values():
            handle.remove()
        self.handles.clear()


def _send(node: Any, **arrays: Array) -> None:
    """Sends the arrays of a node that have changed; a browser then does not upload the others again."""
    for name, array in arrays.items():
        known = getattr(node, name)
        if not np.array_equal(known, rounded := array.astype(known.dtype)):
            setattr(node, name, rounded)


def colors_of(bodies: Indices, color: str) -> Array:
    """Colours (n, 3) of the solids of some bodies, 0 to 255."""
    return np.array([_rgb(color or SOLID_COLORS[b % len(SOLID_COLORS)]) for b in bodies], dtype=np.uint8)


def _scale(x: Array) -> Array:
    """Colours (n, 3), 0 to 255: light grey for 0, orange, dark red for 1; black for entries that are not numbers."""
    stops = np.array([[0.0, 0.5, 1.0], [225, 240, 150], [225, 160, 10], [225, 40, 30]])
    scaled = np.stack([np.interp(x, stops[0], row) for row in stops[1:]], axis=1)
    return np.where(np.isnan(x)[:, None], 0.0, scaled).astype(np.uint8)


def _rgb(color: str) -> tuple[int, int, int]:
    red, green, blue = (int(color[k : k + 2], 16) for k in (1, 3, 5))
    return red, green, blue


def _link_length(marks: Sequence[Mark]) -> float:
    """The median distance of marks from the origins of their bodies, m; infinite if all are at the origins."""
    distances = np.array([np.linalg.norm(mark.at) for mark in marks])
    return float(np.median(distances[distances > 0.0])) if distances.any() else math.inf


def _octahedron(radius: float) -> Surface:
    """The surface of a mark."""
    corners = np.concatenate([np.eye(3), -np.eye(3)]) * radius
    faces = [(a, b, c) if (sx * sy * sz) > 0 else (a, c, b)
             for sx, a in ((1, 0), (-1, 3)) for sy, b in ((1, 1), (-1, 4)) for sz, c in ((1, 2), (-1, 5))]  # fmt: skip
    return corners, np.array(faces)


class Viewer:
    """A view in a browser.

    Parameters
    ----------
    title : str
        Name of the model.
    scene : Scene
    poses : Poses
        Poses at one time, or over a motion.
    folder : Path
        Folder that names of mesh files start from.
    port : int
        Port of this machine; 0: any that is free.
    arrows : str or sequence of str
        Kinds of arrows that are shown at the beginning, see `KINDS`.

    Raises
    ------
    ValueError
        If the port is not available, or a kind of arrows is unknown, or the scene has none of this kind.

    Attributes
    ----------
    url : str
        Address of the view.
    """

    def __init__(
        self, title: str, scene: Scene, poses: Poses, folder: Path, port: int = 0, arrows: str | Sequence[str] = ()
    ):
        viser = need()
        self.arrows = wanted_arrows(arrows, poses)
        _check_port(port)
        self.title, self.poses, self.meshes = title, poses, Meshes(folder)
        with _quiet():
            self.server = viser.ViserServer(host="127.0.0.1", port=port or _free_port(), label=f"ordernm: {title}")
        self.url = f"http://127.0.0.1:{self.server.get_port()}"
        self.server.scene.set_up_direction("+z")
        self.server.scene.configure_default_lights(cast_shadow=False)  # shadows are drawn again for each frame
        low, high = _box(scene, poses)
        self.size = float(np.linalg.norm(high - low)) or 1.0
        centre = (low + high) / 2
        self.server.initial_camera.look_at = centre
        self.server.initial_camera.position = centre + self.size * np.array([0.7, -1.2, 0.5])
        self.server.initial_camera.fov = math.radians(45.0)
        self.server.initial_camera.near, self.server.initial_camera.far = self.size * 1e-3, self.size * 1e3
        self.server.scene.add_grid(
            "/ground", 4 * self.size, 4 * self.size, cell_size=self.size / 10, section_size=self.size / 2,
            fade_distance=20 * self.size, shadow_opacity=0.0,
            position=(float(centre[0]), float(centre[1]), min(float(low[2]), 0.0)),
        )  # fmt: skip
        self.nodes = Nodes(self.server, scene, self.meshes, self.size)
        self.lock = threading.RLock()
        self.shade, self.i = "", 0
        self.show(0)

    def move(self, poses: Poses) -> None:
        """Show the same scene in other poses."""
        self.poses = poses
        self.show(self.i)

    def replace(self, scene: Scene, poses: Poses) -> None:
        """Shows another scene of the model, for example with other parameters."""
        with self.lock:
            self.nodes.remove()
            self.poses, self.nodes = poses, Nodes(self.server, scene, self.meshes, self.size)
            self.show(self.i)

    def show(self, i: int) -> None:
        """Show time i of the poses."""
        with self.lock:
            self.i = min(i, len(self.poses.t) - 1)
            self.nodes.show(self.poses, self.i, self.shade, self.arrows)

    def html(self, path: str | os.PathLike[str]) -> None:
        """Write a page that shows the scene, and plays the motion, without a server and without a network."""
        suffix_among(path, (".html", ".htm"), ValueError, "pages are written as .html")
        with self.lock:
            recording = self.server.get_scene_serializer()
            for i, pause in frames_of(self.poses.t, "page"):
                self.show(i)
                recording.insert_sleep(pause)
            text = recording.as_html().replace("<head>", f"<head>{SLOWER}", 1)
        write_whole(Path(path), lambda file: file.write(f"{text}\n<!-- {MARK} -->\n".encode()))

    def wait(self) -> None:
        """Return when the user presses Ctrl-C."""
        try:
            while True:
                time.sleep(1.0)
        except KeyboardInterrupt:
            pass

    def close(self) -> None:
        """Stop the view."""
        with _quiet():
            self.server.stop()

    def _repr_html_(self) -> str:
        return f'<iframe src="{self.url}" width="100%" height="480" style="border: 0"></iframe>'

    def __repr__(self) -> str:
        return f"<Viewer of {self.title}: {self.url}>"


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Hides the lines that viser prints by rich, also in notebooks."""
    from rich import get_console

    console = get_console()
    before, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = before


def wanted_arrows(arrows: str | Sequence[str], poses: Poses) -> set[str]:
    """Kinds of arrows: names in a list, or separated by commas.

    Raises
    ------
    ValueError
        If a kind is unknown, or the poses have no arrows of this kind.
    """
    wanted = [x.strip() for x in arrows.split(",")] if isinstance(arrows, str) else list(arrows)
    for kind in wanted:
        if kind not in KINDS:
            raise ValueError(f"arrows: {kind!r} is not a kind of arrows; allowed are {', '.join(KINDS)}")
        if kind not in poses.arrows:
            why = (
                "generate the package with reactions"
                if kind == "reactions"
                else "no force element of the model has any"
            )
            raise ValueError(f"arrows: there are no {kind}: {why}")
    return set(wanted)


def frames_of(t: Array, what: str) -> list[tuple[int, float]]:
    """Indices of the results that are shown, each with the time to the next one, s. Warns if more than `MOST_FRAMES`
    would be shown."""
    if len(t) < 2:
        return [(0, 0.0)]
    count = math.ceil((t[-1] - t[0]) * RATE) + 1
    if min(count, len(t)) > MOST_FRAMES:
        warn(f"{min(count, len(t))} frames are too many for a {what}; {MOST_FRAMES} of them are shown")
    wanted = np.linspace(t[0], t[-1], min(count, MOST_FRAMES))
    chosen = np.unique(np.clip(np.searchsorted(t, wanted - 1e-12 * (t[-1] - t[0])), 0, len(t) - 1))
    pauses = np.diff(t[chosen], append=t[chosen[-1]])
    return list(zip(chosen.tolist(), pauses.tolist(), strict=True))


def _box(scene: Scene, poses: Poses) -> tuple[Array, Array]:
    """Corners of a box that contains joints, points and centres of solids at some times."""
    steps = np.unique(np.linspace(0, len(poses.t) - 1, 20).astype(int))
    found = [poses.position[0]]
    for i in steps:
        found += [places_of(scene.marks(kind), poses, i) for kind in MARKS]
        found += [ends_of(scene.lines(kind), poses, i).reshape(-1, 3) for kind in LINES]
        found += [poses.of(s.body, s.at[None], i) for s in scene.solids]
    every = np.concatenate(found)
    every = every[np.isfinite(every).all(axis=1)]
    return every.min(axis=0), every.max(axis=0)


def _check_port(port: int) -> None:
    """Raises an error for ports that do not exist or are in use, for which viser would take another port."""
    if not isinstance(port, int) or not 0 <= port <= LARGEST_PORT:
        raise ValueError(f"port is {port!r}; 1 to {LARGEST_PORT} are allowed, and 0 for any that is free")
    with socket.socket() as s:
        s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            s.bind(("127.0.0.1", port))
        except OSError as error:
            raise ValueError(f"port {port} is not available ({error.strerror}); give another one, or none") from None


def _free_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        port: int = s.getsockname()[1]
        return port
