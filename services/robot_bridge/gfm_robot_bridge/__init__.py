"""Stands between policies and the robot: commands in, observations and recordings out."""
