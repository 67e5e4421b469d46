"""Voxels: where they are, what they hold, how they are read, written and segmented."""
