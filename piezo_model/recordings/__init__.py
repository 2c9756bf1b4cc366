"""Recordings of an actuator: files of any format, read once into two arrays, and repaired if that is safe.

path
 │   formats.open_tables  first bytes → the reader of the format, which checks sizes before it reads
 │   opening.open_table   of several tables, the one that can be the recording or that the user names
 ▼
Table                     named columns (`array_table`, also of `Recording.of`; of text: `layout`, `formats.text`)
 │   roles.choose_roles   by name, unit and elimination; time also by its values
 │   Table.read           the chosen columns as float64, clocks as seconds (`clock_cells`)
 ▼
Rows                      times and signals
 │   opening.read_signals unknown and bad values (`bad_values`), repeats and parts (`rows`), the period
 │                        (`clock`), an even clock, a question if the values are implausible for their units
 ▼
Recording(x, y)           with starts, uncounted and remarks (`recording`; in two files: `opening.joined`)
"""

from piezo_model.recordings.recording import Recording, Reference, read_reference
from piezo_model.recordings.table import RecordingError
from piezo_model.recordings.writer import write_table

__all__ = ["Recording", "RecordingError", "Reference", "read_reference", "write_table"]
