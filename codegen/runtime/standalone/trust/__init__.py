"""How far results can be trusted: rounding errors, diagnosis, more digits, single precision."""
