"""One module for each kind of section of a model: it resolves the entries and reports their errors."""
