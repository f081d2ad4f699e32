"""Import of robots: from URDF, MJCF and SDF files, and from objects of Pinocchio, MuJoCo and sympy."""

from .importer import Imported, from_mujoco, from_pinocchio, import_model
from .options import Options
from .sympy_model import from_sympy

__all__ = ["Imported", "Options", "from_mujoco", "from_pinocchio", "from_sympy", "import_model"]
