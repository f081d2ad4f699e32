"""The version of ordernm."""

__version__ = "0.1.0"
