"""What is measured: energies, points, formulas."""
