"""The terms of the objective: log-likelihood, prior, beam hardening."""
