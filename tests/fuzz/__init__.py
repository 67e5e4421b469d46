"""Random messages and damaged files."""
