"""Closes the gap between a MuJoCo model and the robot it stands for."""

__version__ = "0.1.0"
