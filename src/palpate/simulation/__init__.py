"""The simulation: the 1 kHz loop, its commands, records and scores."""
