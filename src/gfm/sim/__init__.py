"""The Sawyer cell, plants with effects in them, their predictions, hybrid stepping in batch."""
