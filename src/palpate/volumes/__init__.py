"""Volumes and labels: their grids, files, segmentation and quality measures."""
