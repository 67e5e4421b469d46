"""Whole experiments, each ending in one HTML report."""
