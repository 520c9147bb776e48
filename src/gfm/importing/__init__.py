"""Files of other tools as recordings: their formats, mappings, and guesses of mappings."""

from gfm.importing.conversion import imported
from gfm.importing.mapping import load_mapping, mapping_of

__all__ = ["imported", "load_mapping", "mapping_of"]
