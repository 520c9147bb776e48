"""Hypotheses, the moves between them, and the loop that chooses."""
