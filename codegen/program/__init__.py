"""Statements, blocks, passes, derivatives: symbolic programs that know no mechanics."""
