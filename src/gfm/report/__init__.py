"""The diagnosis as one HTML file: pure functions from values to text."""
