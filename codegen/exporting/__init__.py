"""Exports of solvers to other programs."""
