"""What ``piezobench experiment`` made and said."""

from dataclasses import dataclass
from pathlib import Path

import pandas as pd
from command_line import Finished


@dataclass(frozen=True)
class Figures:
    folder: Path
    call: Finished

    @property
    def page(self) -> str:
        return (self.folder / "experiment.md").read_text(encoding="utf-8")

    def table(self, name: str) -> pd.DataFrame:
        return pd.read_csv(self.folder / "figures" / f"{name}.csv")
