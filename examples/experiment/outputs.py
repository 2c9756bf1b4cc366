"""What the scripts of this folder share: their options, and how a figure is written beside its numbers."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from bench.report import svg
from bench.report.report import Figure
from bench.rig.rig import Rig


def arguments(**options: Any) -> argparse.Namespace:
    """The folder ``--out``, and further options with their defaults."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--out", type=Path, default=Path("results/experiment"), help="folder of the figure and its numbers")
    for name, default in options.items():
        kind = {"action": "store_true"} if default is False else {"type": type(default), "default": default}
        parser.add_argument(f"--{name}", **kind)
    return parser.parse_args()


def rig_of(given: argparse.Namespace, **options: Any) -> Rig:
    """The paper's rig, or the one of ``--quick``."""
    return (Rig.quick if given.quick else Rig)(**options)


def show(figure: Figure, sentences: Iterable[str], folder: Path) -> None:
    """Write ``<name>.svg`` and ``<name>.csv``, and print the title and what the numbers say."""
    folder.mkdir(parents=True, exist_ok=True)
    svg.write(figure.plots, folder / f"{figure.name}.svg")
    figure.data.to_csv(folder / f"{figure.name}.csv", index=False, float_format="%.6g")
    print(figure.title, *sentences, sep="\n- ")
