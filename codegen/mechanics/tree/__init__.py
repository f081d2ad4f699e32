"""The sweeps of the paper over a tree, on scalars and along directions."""
