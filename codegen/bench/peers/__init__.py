"""Other programs that solve problems of the benchmark, one per file; each is imported only if it is installed."""
