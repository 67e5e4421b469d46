"""Which lesions a reader could find in each method's image of a breast: random breasts, model observers."""
