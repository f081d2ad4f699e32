"""The run time of a generated solver: compiles its C code once, checks arguments, and calls the compiled functions.

It requires NumPy, and cffi for the C target. The package's ``model.json`` describes the generated functions and their arguments;
the run time contains no mechanics. Start reading at `calls.package`.
"""
