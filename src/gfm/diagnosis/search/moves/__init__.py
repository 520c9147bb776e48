"""The moves from one hypothesis to another: each returns a step, and none decides by a threshold.

What is better is told by the score alone (`gfm.diagnosis.inference.score`).
"""
