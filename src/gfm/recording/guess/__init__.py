"""A mapping that fits a file to a model, with a reason for every line."""

from gfm.recording.guess.guess import guessed_mapping
from gfm.recording.guess.robot import Asked, Robot

__all__ = ["Asked", "Robot", "guessed_mapping"]
