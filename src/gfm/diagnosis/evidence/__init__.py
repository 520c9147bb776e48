"""The evidence chain: what a reader can check for himself, step by step, of how a verdict came.

All of it is measured on held-out recordings, none of it decides anything: the score does
(`gfm.diagnosis.inference.score`). A step that cannot be taken is left empty, not passed.
"""
