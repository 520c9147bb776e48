"""Recordings as a diagnosis sees them: segments, quality."""
