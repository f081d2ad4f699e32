"""Functional mock-up units: models for simulators that import FMI 3.0 or 2.0."""
