"""Films for reports: what is shown is decided here, and drawn by a process of its own."""
