"""Loops: the links that close them, in the axes of their region."""
