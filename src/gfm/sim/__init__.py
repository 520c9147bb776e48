"""The Sawyer cell, and hybrid models stepped in batch."""
