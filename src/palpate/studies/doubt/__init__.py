"""How far intervals of a lump and the probability that a hand feels it can be trusted, on bodies whose truth is known."""
