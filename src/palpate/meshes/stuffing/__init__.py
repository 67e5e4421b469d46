"""Isosurface stuffing: tetrahedra from the signed distance of a label (Labelle & Shewchuk 2007)."""
