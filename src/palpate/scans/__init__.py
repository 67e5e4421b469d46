"""Scans: geometry, counts, files and simulation."""
