"""Projections, likelihoods and forces with derivatives, for JAX, PyTorch and DeepInverse."""
