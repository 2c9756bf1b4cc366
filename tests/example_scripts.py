"""Run the scripts in ``examples/``."""

from pathlib import Path

from command_line import python, without_waiting

ROOT = Path(__file__).parent.parent


def run_example(script: str, *words: object) -> str:
    """Output of a script, which must succeed."""
    done = python(ROOT / "examples" / script, *words, PYTHONPATH=str(ROOT))
    assert without_waiting(done.stderr) == ""
    return done.stdout
