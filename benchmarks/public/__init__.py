"""Public recordings of measured robots: where each is from, and how it becomes a case.

None of the data is in this project. A set names repository, commit, licence and the SHA-256 of
every file that it reads; `../public_sets.py` diagnoses the sets and writes what came of it.
"""

from public.sets import SETS
from public.source import PublicSet

__all__ = ["SETS", "PublicSet"]
