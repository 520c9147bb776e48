"""Robots whose truth is known: written apart from `gfm`, to judge what it makes of them.

Nothing here imports `gfm` or MuJoCo: another rigid-body dynamics, another integrator and time
step, another friction, another sensor. The nominal model of each robot is written as MJCF text
from the same numbers.
"""
