"""Equilibria and linearised equations, with second derivatives."""
