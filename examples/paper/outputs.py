"""Functions shared by the scripts of this folder: command-line options, and the report of figures with their data."""

import argparse
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from bench.report.report import Figure, Report
from bench.report.writing import write_report


def arguments(**options: Any) -> argparse.Namespace:
    """Parsed command line with ``--out``, the folder of the report, and further options with their defaults."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--out", type=Path, default=Path("results/paper"), help="folder of the report")
    for name, default in options.items():
        kind = {"action": "store_true"} if default is False else {"type": type(default), "default": default}
        parser.add_argument(f"--{name}", **kind)
    return parser.parse_args()


def show(figure: Figure | Sequence[Figure], sentences: Iterable[str], folder: Path) -> None:
    """Write the report of a figure, or of several, and its sentences, and print the sentences."""
    folder.mkdir(parents=True, exist_ok=True)
    figures = [figure] if isinstance(figure, Figure) else figure
    report = Report([*sentences], figures=figures, title=figures[0].title)
    written = write_report(report, folder, figures[0].name, len(figures))
    print(*report.verdict, f"Report: {written}", sep="\n")
