"""The evidence chain: what a reader can check for himself, step by step, of how a verdict came.

All of it is measured on held-out recordings. It decides nothing: the score (`inference`) does.
"""
