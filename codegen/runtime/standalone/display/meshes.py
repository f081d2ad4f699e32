"""Meshes of files, read by trimesh where it is installed."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..warning import warn
from .scene import Solid
from .surfaces import Surface, surface_of

INSTEAD = 0.05
"""Edge of the cube that is shown for a mesh that cannot be read, m."""


class Meshes:
    """Reads the mesh files of a scene, each once.

    Parameters
    ----------
    folder : Path
        Folder that relative names of files start from.
    """

    def __init__(self, folder: Path):
        self.folder = folder
        self._found: dict[str, Surface | None] = {}

    def surface(self, solid: Solid, alike: int = 1) -> Surface:
        """The surface of a solid in its own frame; `alike` solids have this surface. A mesh that cannot be read becomes
        a small cube, with a warning."""
        if solid.type != "mesh":
            return surface_of(solid, alike)
        if solid.file not in self._found:
            self._found[solid.file] = self._read(solid.file)
        found = self._found[solid.file]
        if found is None:
            return surface_of(Solid(solid.body, "box", np.full(3, INSTEAD), solid.rotation, solid.at))
        return found[0] * solid.sizes, found[1]

    def _read(self, name: str) -> Surface | None:
        path = self.folder / name
        if not path.is_file():
            warn(f"mesh {name} is not a file in {self.folder}; a cube of {INSTEAD:g} m is shown instead")
            return None
        try:
            import trimesh
        except ImportError:
            warn(f'mesh {name} needs trimesh: pip install "ordernm[view]"; a cube of {INSTEAD:g} m is shown instead')
            return None
        try:
            mesh = trimesh.load_mesh(path)
            return np.asarray(mesh.vertices, float), np.asarray(mesh.faces, int)
        except (ImportError, ValueError, OSError, KeyError, IndexError, AttributeError, NotImplementedError) as error:
            warn(f"mesh {name} cannot be read ({error}); a cube of {INSTEAD:g} m is shown instead")
            return None
