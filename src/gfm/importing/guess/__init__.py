"""A mapping that fits a file to a model, with a reason for every line."""

from gfm.importing.guess.guess import guessed_mapping
from gfm.importing.guess.robot import Asked, Robot

__all__ = ["Asked", "Robot", "guessed_mapping"]
