"""Generic engines for any model: the witnesses the generated code is tested against. No code generation here."""

from .dense import DenseEngine
from .recursive import RecursiveEngine

__all__ = ["DenseEngine", "RecursiveEngine"]
