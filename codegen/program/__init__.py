"""Statements, blocks, passes and derivatives: symbolic programs without any knowledge of mechanics."""
