"""The loop and the paper's protocol, as commands."""
