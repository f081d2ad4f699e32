"""Structure of a model: links, ears, regions, the order of the sweeps, and kinds and constants of these units."""
