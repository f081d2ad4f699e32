"""What a solver computes of a state, a method each: accelerations, energies, outputs, forces, reactions, frames."""
