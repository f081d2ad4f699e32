"""Robots of other formats as models: URDF, MJCF, SDF, and objects of Pinocchio and MuJoCo."""

from .importer import Imported, Options, import_model

__all__ = ["Imported", "Options", "import_model"]
