"""What a model gets wrong about the object that its robot pushes.

The robot's joints follow their recorded motion; the object is simulated under contact from where it
was measured, over short segments in which it moves.
"""
