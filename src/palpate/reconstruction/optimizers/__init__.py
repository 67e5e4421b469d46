"""Optimizers of the posterior: coordinate descent, memory gradient, ordered subsets, and a hybrid of the first two."""
