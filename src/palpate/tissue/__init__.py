"""Tissue: reference solutions by finite elements, and models that answer a push in real time."""
