"""Files of a package: its manifest, compilation, and the cache of compiled libraries."""
