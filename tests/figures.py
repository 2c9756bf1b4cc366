"""Files and output of ``piezobench experiment``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from command_line import Finished
from programs import library


@dataclass(frozen=True)
class Figures:
    folder: Path
    call: Finished

    @property
    def page(self) -> str:
        return (self.folder / "experiment.md").read_text(encoding="utf-8")

    def table(self, name: str) -> Any:
        return library("pandas").read_csv(self.folder / "figures" / f"{name}.csv")
