"""Projections: geometry, counts, files, and simulated scans."""
