"""Functions shared by the scripts of this folder: command-line options, and the report of a figure with its data."""

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from bench.report.report import Figure, Report
from bench.report.writing import write_report
from bench.stage.setup import StageSetup


def arguments(**options: Any) -> argparse.Namespace:
    """Parsed command line with ``--out``, the folder of the report, and further options with their defaults."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--out", type=Path, default=Path("results/paper"), help="folder of the report")
    for name, default in options.items():
        kind = {"action": "store_true"} if default is False else {"type": type(default), "default": default}
        parser.add_argument(f"--{name}", **kind)
    return parser.parse_args()


def setup_of(given: argparse.Namespace, **options: Any) -> StageSetup:
    """The paper's setup, or the shorter one with ``--quick``."""
    return (StageSetup.quick if given.quick else StageSetup)(**options)


def show(figure: Figure, sentences: Iterable[str], folder: Path) -> None:
    """Write the report of a figure and its sentences, and print the sentences."""
    folder.mkdir(parents=True, exist_ok=True)
    report = Report([*sentences], figures=[figure], title=figure.title)
    written = write_report(report, folder, figure.name)
    print(*report.verdict, f"Report: {written}", sep="\n")
