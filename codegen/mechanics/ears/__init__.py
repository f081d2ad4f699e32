"""Loops: the links that close them, along the axes of their region."""
