"""Recordings of an actuator: files of any format that are checked once, read in chunks and never trusted blindly.

A voltage on its way from a file to a weight passes

    formats/*           ``batches``: text by Arrow, after `dialect` and `text_table`; binary formats by their libraries,
                        in a child process (`subprocess_reader`)
    tables              ``Table.pieces``: float64, (columns, rows)
    roles, profile      which column is what, by names, and by values where these do not say it
    scan                ``scan``: values and clock (`sampling`) checked, held, streamed, or interpolated, in one pass
    recording           ``Recording.chunks``
    identification      `preprocessing` (sign, transient, initial state), `sensor_lag`; `fitting.accumulate`: the sums
                        of (6), `fitting.optimum`: the weights; `fitting.forward_error`, `adequacy`, `fit_report`: their
                        worth

and enters none of these files twice but where a recording is too long to be held.
"""

from piezo_model.recordings.chunks import RecordingError
from piezo_model.recordings.recording import Recording, Reference, read_reference
from piezo_model.recordings.writer import write_table

__all__ = ["Recording", "RecordingError", "Reference", "read_reference", "write_table"]
