"""Recordings in and out: MCAP, and import from CSV and JSON."""
