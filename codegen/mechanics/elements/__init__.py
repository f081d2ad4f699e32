"""Force elements between points of bodies."""
