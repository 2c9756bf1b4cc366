"""Recordings of an actuator: files of any format, checked once and read in chunks.

The data pass through these modules on their way from a file to the weights, each module once unless the recording is
too long to be held in memory:

    formats/*           ``batches``: text by Arrow, after `dialect` and `text_table`; binary formats by their libraries,
                        in a child process (`subprocess_reader`)
    tables              ``Table.chunks``: float64, (columns, rows)
    roles, profile      the role of each column, by its name or by its values
    scan                ``scan``: values and clock (`sampling`) checked, held, streamed, or interpolated, in one pass
    recording           ``Recording.chunks``
    identification      `preprocessing` (sign, transient, initial state), `sensor_lag`; `fitting.accumulate`: the sums
                        of (6), `fitting.optimum`: the weights; `fitting.forward_error`, `adequacy`, `fit_report`: their
                        errors
"""

from piezo_model.recordings.chunks import RecordingError
from piezo_model.recordings.recording import Recording, Reference, read_reference
from piezo_model.recordings.writer import write_table

__all__ = ["Recording", "RecordingError", "Reference", "read_reference", "write_table"]
