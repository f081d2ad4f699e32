"""Printers and writers for C and NumPy: they use blocks and memory and know no mechanics."""
