"""Accuracy of results: rounding errors, diagnosis, more digits, single precision."""
