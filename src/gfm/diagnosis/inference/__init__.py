"""Fits, intervals and the score by which hypotheses are compared."""
