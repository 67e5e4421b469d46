"""What the loop needs of a device: a position in, a force out."""
