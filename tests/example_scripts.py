"""Run the scripts in ``examples/``."""

import os
import subprocess
import sys
from pathlib import Path

from command_line import without_waiting

ROOT = Path(__file__).parent.parent


def run_example(script: str, *words: object) -> str:
    """Output of a script, which must succeed."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, str(ROOT / "examples" / script), *map(str, words)],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, without_waiting(done.stderr)) == (0, "")
    return done.stdout
