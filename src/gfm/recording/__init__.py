"""Recordings in and out: MCAP, and import from what other tools write."""

from gfm.recording.reader import read_recording
from gfm.recording.writer import RecordingWriter, write_recording

__all__ = ["RecordingWriter", "read_recording", "write_recording"]
