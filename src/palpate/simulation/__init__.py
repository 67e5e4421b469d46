"""The 1 kHz loop, and the devices that hold the other end."""
