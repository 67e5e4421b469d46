"""Deliberate faults: does a test notice each of them? `make mutants SEED=1 N=100`."""
