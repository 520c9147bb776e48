"""What a model gets wrong about the object that its robot pushes, by segments of its motion."""
