"""Assembly of closed loops: consistent states, branches, and the choice of dependent coordinates."""
