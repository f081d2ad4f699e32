"""Calls of the generated functions, in C or NumPy: checks and conversion of arguments and results, for states and batches."""
