"""Models: the file format, the builder, expressions, and the checked model."""

from .builder import ModelBuilder
from .errors import ModelError, Problem
from .expressions import Expression
from .loading import load_model, parse_model
from .model import Model

__all__ = ["Expression", "Model", "ModelBuilder", "ModelError", "Problem", "load_model", "parse_model"]
