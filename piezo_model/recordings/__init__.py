"""Recordings of an actuator: CSV and Parquet files that are checked once, read in chunks and never trusted blindly."""

from piezo_model.recordings.pieces import RecordingError
from piezo_model.recordings.recording import Recording, Reference, read_reference
from piezo_model.recordings.writer import write_table

__all__ = ["Recording", "RecordingError", "Reference", "read_reference", "write_table"]
