"""The server that children are forked from, since their libraries take long to import.

It has imported the modules that all children need, with every thread pool limited to one thread; one of them is
qpsolvers, which imports every library that it finds. Nothing is imported from the working folder, where a file
``queue.py`` or a folder ``solvers`` would come first.
"""

import os
import sys
import tempfile
import threading
from collections.abc import Iterable
from multiprocessing import forkserver

from bench.messages.task import RaceError
from solvers.registry import FAMILIES, Entry

THREAD_VARIABLES = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS",
)
PRELOADED = (
    "bench.processes.child_process",
    "bench.processes.worker",
    "bench.problems.foreign",
    "bench.races.worker",
    "solvers.core",
)
"""Modules that the server always imports; it ignores missing ones."""


_starting = threading.Lock()


def warm_up(entries: Iterable[Entry] = ()) -> None:
    """Start the server, which imports what the lanes of these solvers need, too.

    It imports for a second or two in the background; a server that is already running is left unchanged. RaceError if
    the path of its socket is too long.
    """
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, "1"))
    lanes = {f"solvers.{entry.lane}_lane" for entry in entries if entry.lane in FAMILIES}
    forkserver.set_forkserver_preload([*PRELOADED, *lanes])
    # the server, and nothing else that this program starts, imports from where this program does
    own = {"PYTHONSAFEPATH": "1", "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    with _starting:
        before = {name: os.environ.pop(name) for name in own if name in os.environ}
        os.environ.update(own)
        try:
            forkserver.ensure_running()
        except OSError as error:
            if "AF_UNIX path too long" not in str(error):
                raise
            raise RaceError(
                f"{tempfile.gettempdir()} has too long a name for the sockets of the solvers' processes; "
                "set TMPDIR to another folder"
            ) from None
        finally:
            for name in own:
                del os.environ[name]
            os.environ.update(before)
