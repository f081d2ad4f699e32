"""Generic engines for any model: independent references for tests of the generated code. They generate no code."""

from .dense import DenseEngine
from .recursive import RecursiveEngine

__all__ = ["DenseEngine", "RecursiveEngine"]
