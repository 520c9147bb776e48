"""Learns from replayed sequences and broadcasts the policy."""
