"""The head study: every view left out once."""
