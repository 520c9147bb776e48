"""Writes the reference page of the wire format to standard output."""

import sys

from gfm_wire.reference import reference_page

sys.stdout.write(reference_page())
