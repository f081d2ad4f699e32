"""Files of a package on disk: its manifest, the compiler and the libraries that it makes, where they are kept."""
