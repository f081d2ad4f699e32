"""Pictures and animations of mechanisms: the objects in a view and their places."""
