"""Recordings in and out: MCAP, written, read, checked, cut, exported."""

from gfm.recording.reader import read_recording
from gfm.recording.writer import RecordingWriter, write_recording

__all__ = ["RecordingWriter", "read_recording", "write_recording"]
