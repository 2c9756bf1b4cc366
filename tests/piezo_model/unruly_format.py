"""A format whose files contain the failure of the process that reads them."""

import os
import signal
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from piezo_model.recordings.tables import ArrayTable, Column, ReadOptions, parsed


def open_table(path: Path, reading: ReadOptions) -> ArrayTable:
    match path.read_text():
        case "crash":
            os.kill(os.getpid(), signal.SIGSEGV)
        case "exit":
            print("goodbye", flush=True)
            os._exit(3)
        case "eat":
            with parsed(path, "unruly"):
                np.ones(2**40)
        case "hang":
            started = path.with_name("starting")
            started.write_text(str(os.getpid()))
            started.rename(path.with_name("busy"))
            time.sleep(1000.0)
    return ArrayTable(path, "unruly", (Column.named("x", rows=100),), [Crashing()])


class Crashing:
    """An array that ends the process when its rows are read."""

    def __getitem__(self, rows: slice) -> NDArray[np.float64]:
        os.kill(os.getpid(), signal.SIGSEGV)
        return np.zeros(rows.stop - rows.start)
