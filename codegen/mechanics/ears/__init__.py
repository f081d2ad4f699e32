"""Closed loops, as ears: blocks of the links that close them. An ear is one of an ear decomposition of a graph (Whitney 1932)."""
