"""Results of a motion: the trajectory with its events, its files, tables and pictures."""
