"""Tissue models: each answers pushes in real time."""
