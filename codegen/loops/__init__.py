"""Closed loops before any symbol: where they are, how they close, which coordinates depend on which. Floats only."""
