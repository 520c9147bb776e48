"""A model and recordings checked against each other, before anything runs.

Every check is a pure function from values to `Check`s; `examine` asks them in the order in which a
reader mends things, and goes on where a diagnosis would stop at the first objection.
"""
