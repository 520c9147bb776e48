"""Starts, watches and stops the services as processes of this machine."""
