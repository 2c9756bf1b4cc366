"""A new kind of race is one new folder and nothing else, by the example of the documentation."""

import re
import subprocess
import sys
from pathlib import Path

import documents
import pandas as pd
import pytest

import bench
from bench.races.kind import kinds

PAGE = Path(__file__).parents[2] / "docs" / "adding-a-race.md"
STOP = """        if task.repeat and (self.run.path.parent / "stop").exists():
            raise OSError("the coin rolled away")
"""


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Links to the package, and a new folder beside those of the other races, whose race can be stopped after a
    task."""
    root, real = tmp_path_factory.mktemp("root"), Path(bench.__file__).parent
    toss = root / "bench" / "races" / "toss"
    toss.mkdir(parents=True)
    (toss / "__init__.py").touch()
    for source in (*real.iterdir(), *(real / "races").iterdir()):
        target = root / "bench" / source.relative_to(real)
        if not target.exists():
            target.symlink_to(source)
    for block in documents.blocks(PAGE):
        text = re.sub(r"( +def judged\(.*\n)", rf"\1{STOP}", block.text)
        (toss / block.rest.removeprefix('title="').removesuffix('"')).write_text(text)
    return root


def test_the_page_lists_every_kind_of_race() -> None:
    listed = re.findall(r"^\| `(\w+)` \|", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert set(listed) == set(kinds())
    assert len(listed) == len(kinds())


def piezobench(root: Path, *words: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "bench", *map(str, words)], cwd=root, capture_output=True, text=True, check=False
    )


def test_a_new_folder_races_stops_resumes_and_reports(root: Path) -> None:
    (root / "stop").touch()
    run = root / "run"
    options = (
        "race",
        "--race",
        "toss",
        "--tosses",
        4,
        "--solver",
        "daqp",
        "--lane",
        "direct",
        "--out",
        root,
        "--name",
        "run",
    )
    stopped = piezobench(root, *options)
    assert stopped.returncode == 2, stopped.stderr
    assert "the coin rolled away; finished tasks are kept" in stopped.stderr
    assert len(list((run / "tasks").glob("*.npz"))) == 1
    (root / "stop").unlink()
    resumed = piezobench(root, "resume", run)
    assert resumed.returncode == 0, resumed.stderr
    assert "2 of 4 tosses show heads." in resumed.stdout
    rows = pd.read_parquet(run / "toss.parquet")
    assert rows["repeat"].tolist() == [0, 1, 2, 3]
    assert set(rows.status) == {"daqp"}
    for name, part in (("report.md", "# Toss race run"), ("report.html", "Toss race run"), ("summary.csv", "daqp")):
        assert part in (run / name).read_text()


def test_the_options_of_a_new_kind_are_those_of_its_race_alone(root: Path) -> None:
    refused = piezobench(root, "race", "--race", "stream", "--tosses", 4)
    assert refused.returncode == 2
    assert "--tosses: is for the race toss; the race stream does not use it" in refused.stderr
