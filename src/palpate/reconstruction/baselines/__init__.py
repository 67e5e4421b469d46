"""Methods without a prior: backprojection, FBP, SART, SIRT; and total variation."""
