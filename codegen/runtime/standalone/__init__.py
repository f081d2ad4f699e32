"""The run time of a generated solver: compiles its C once, checks arguments, carries arrays to the compiled functions.

It needs NumPy, and cffi for the C target. What the generated functions are called and what they take stands in the package's
``model.json``; nothing here knows mechanics. `package` is where to begin: what a solver is put together from.
"""
