"""Motions over time: inputs, the run of the integrator, events, sensitivities and gradients."""
