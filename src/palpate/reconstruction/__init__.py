"""Reconstruction: projector, likelihood, prior, optimizers, resolution levels."""
