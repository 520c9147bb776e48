"""The command `gfm`."""
