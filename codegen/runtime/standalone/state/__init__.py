"""Quantities of one state: Jacobians, gradients, mass matrices, inverse dynamics, reactions, frames and points."""
