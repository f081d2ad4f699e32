"""One module for each kind of section of a model: what it means, and what is wrong with it."""
