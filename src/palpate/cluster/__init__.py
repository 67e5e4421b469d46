"""Archives: one command over many files, on the workers of Dask's scheduler."""
