"""Closed loops, as ears: blocks of the links that close them. See the ear decomposition of a graph (Whitney 1932)."""
