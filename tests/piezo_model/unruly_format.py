"""A reader of files that contain the failure of the process that reads them."""

import os
import signal
import time
from pathlib import Path

import numpy as np

from piezo_model.recordings.array_table import Arrays
from piezo_model.recordings.options import ReadOptions


def read(path: Path, options: ReadOptions) -> Arrays:
    match path.read_text():
        case "crash":
            os.kill(os.getpid(), signal.SIGSEGV)
        case "exit":
            print("goodbye", flush=True)
            os._exit(3)
        case "eat":
            np.ones(2**40)
        case "hang":
            started = path.with_name("starting")
            started.write_text(str(os.getpid()))
            started.rename(path.with_name("busy"))
            time.sleep(1000.0)
    return Arrays("unruly", {"x": np.arange(100), "y": np.arange(100.0)[::-1]})
