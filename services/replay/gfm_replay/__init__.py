"""Keeps sequences and hands out batches of them."""
