"""Measured minus predicted: rollouts in segments, initial states, integration, channels."""
