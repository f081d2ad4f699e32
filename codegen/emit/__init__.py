"""Printers and writers for C and NumPy: they know blocks and memory, no mechanics."""
