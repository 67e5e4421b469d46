"""Tetrahedral meshes from labels."""
