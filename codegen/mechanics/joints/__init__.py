"""How vectors and inertias pass a joint."""
