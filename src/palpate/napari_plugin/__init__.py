"""What palpate adds to napari: readers, and panels that reconstruct a scan and make a labelled organ one to touch."""
