"""From labels to a solid of tetrahedra."""
