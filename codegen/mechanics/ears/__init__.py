"""Closed loops: blocks of the ears, the groups of links that close them (ear decomposition of a graph, Whitney
1932)."""
