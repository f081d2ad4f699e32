"""The version of ordernm."""

__version__ = "0.2.0"
