"""The search before."""
