"""Residual, adequacy, attribution, correction."""
