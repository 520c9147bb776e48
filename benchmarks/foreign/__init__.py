"""Files as other people have them, made of recordings that are at hand: see `transcripts.py`.

Each module writes the files of one robot into a folder. Measured and simulated data stay outside
the repository; nothing here makes numbers up.
"""

from foreign.cutting import Sources

__all__ = ["Sources"]
