"""What a model gets wrong about the object that its robot pushes.

The robot's joints follow their recorded motion; the object is simulated over short segments.
"""
