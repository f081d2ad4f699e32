"""From Python's arguments to the compiled function, or the NumPy one, and back: one state, a few, or a batch."""
