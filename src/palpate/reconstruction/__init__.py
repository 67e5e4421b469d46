"""From projections to a volume: projector, likelihood, prior, descent, multi-resolution."""
