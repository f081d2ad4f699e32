"""Pictures and animations of mechanisms: what a view shows, and where it is."""
