"""Recordings as a diagnosis sees them: noise, segments, quality."""
