"""Robots of other formats as models: URDF, MJCF, SDF, and objects of Pinocchio and MuJoCo."""

from .importer import Imported, Options, from_mujoco, from_pinocchio, import_model

__all__ = ["Imported", "Options", "from_mujoco", "from_pinocchio", "import_model"]
