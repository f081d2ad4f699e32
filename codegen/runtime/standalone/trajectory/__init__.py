"""What a motion returns: the trajectory with its events, its files, tables and pictures."""
