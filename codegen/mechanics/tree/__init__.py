"""The sweeps over a tree: for values and for derivatives along directions."""
