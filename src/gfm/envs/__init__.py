"""The learning problems, batched underneath and Gymnasium on top."""
