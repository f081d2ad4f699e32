"""Other programs on the problems of the benchmark: a file each, imported where one is installed."""
