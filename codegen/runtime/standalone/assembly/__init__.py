"""States that meet the conditions of closed loops: the search for them, their branches and dependents."""
