"""Force-feedback devices, found at run time and driven by the core."""
