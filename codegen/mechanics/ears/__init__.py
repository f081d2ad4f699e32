"""Closed loops, as ears: blocks of the links that close them. The term is from the ear decomposition of a graph (Whitney 1932)."""
