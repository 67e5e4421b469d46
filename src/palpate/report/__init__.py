"""Reports and figures: HTML pages, tables, plots."""
