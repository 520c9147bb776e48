"""The simulated Sawyer behind Intera's topics and a rosbridge, as a real one would be."""
