"""The command line: help, refusals that leave nothing behind, and the way from a recording to a drive."""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command_line import CommandLine, Finished, contents, in_process
from hostile_files import spoiled
from small_races import REFERENCE, Race
from typer.main import get_command

from bench.cli.app import VERBS, command_line
from bench.problems import all_sets
from bench.timing import cores
from piezo_model import plants
from piezo_model.recordings import write_table
from piezo_model.signals import multi_sine

SAMPLE_TIME = 1e-3


def actuator() -> plants.Actuator:
    return plants.get("dense_prandtl_ishlinskii", sample_time=SAMPLE_TIME)


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a good recording, a good reference, and bad ones of either and of runs."""
    folder = tmp_path_factory.mktemp("desk")
    plant = actuator()
    low, high = plant.x_range
    x = multi_sine(duration_s=8.0, sample_time=SAMPLE_TIME, low=low, high=high, seed=1)
    y, t = plant.run(x), np.arange(x.size) * SAMPLE_TIME
    write_table(folder / "stage.csv", {"time_s": t, "voltage_V": x, "displacement_um": y})
    slow = np.interp(t, [0.0, 1.0], [0.0, 1.0]) * (0.5 + 0.35 * np.sin(2 * np.pi * 0.5 * t))
    write_table(folder / "path.csv", {"time_s": t, "reference_um": y.min() + np.ptp(y) * slow})
    header, *rows = (folder / "stage.csv").read_text().splitlines()
    rows[69] = f"{rows[69].split(',')[0]},high,1"
    write_table(folder / "volts.csv", {"time_s": t, "reference_V": t})
    for name in ("empty", "foreign", "broken", "full"):
        (folder / name).mkdir()
    np.savez(folder / "foreign" / "indefinite.npz", P=np.diag([1.0, -1.0]), q=np.zeros(2))
    for name, text in (
        ("two.csv", "\n".join([header, *rows[:2]])),
        ("text.csv", "\n".join([header, *rows])),
        ("broken.xlsx", "PK"),
        ("nan.csv", "time_s,reference_um\n0,1\n0.001,NaN\n0.002,1\n"),
        ("fleet.csv", "time_s,reference_um\n0,1\n0.001,1\n0.002,1\n"),
        ("path-drive.csv", "time_s,reference_um\n0,1\n0.001,1\n0.002,1\n"),
        ("file", ""),
        ("empty.py", ""),
        (
            "compiled.py",
            "from solvers.kernel.box_active_set import BoxActiveSet\nclass Mine(BoxActiveSet):\n    name = 'mine'\n",
        ),
        ("full/it.fmu", "mine"),
        ("foreign/run.json", "{}"),
        ("broken/run.json", '{"settings": {'),
    ):
        (folder / name).write_text(text)
    return folder


@pytest.fixture(scope="module")
def identified(piezobench: CommandLine, desk: Path) -> None:
    """Write a model into the folder, and a truncated copy of it."""
    piezobench.quietly(
        "identify",
        "stage.csv",
        "--time",
        "time_s",
        "--input",
        "voltage_V",
        "--output",
        "displacement_um",
        "--out",
        "model.json",
        folder=desk,
    )
    model = (desk / "model.json").read_text()
    (desk / "half.json").write_text(model[: len(model) // 2])
    (desk / "invalid.json").write_bytes(*spoiled(json.loads(model), ("w_H", 0), "0.0"))


def refused(piezobench: Callable[..., Finished], folder: Path, *words: object, **options: int) -> str:
    """The sentence of a call that is refused and leaves the folder as it was."""
    before = contents(folder)
    sentence = piezobench(*words, folder=folder, **options).refusal
    assert contents(folder) == before
    return sentence


# Help and usage.


@pytest.mark.parametrize("verb", VERBS)
def test_the_help_of_a_verb_describes_it_and_its_options(piezobench: CommandLine, verb: str) -> None:
    assert piezobench.quietly(verb, "--help").stdout.startswith(f"Usage: piezobench {verb}")
    options = vars(get_command(command_line([verb])))["commands"][verb].params
    assert not [option.name for option in options if not option.help]


def test_the_version_is_that_of_the_package(piezobench: CommandLine) -> None:
    assert piezobench.quietly("--version").stdout == f"piezobench {version('piezobench')}\n"


@pytest.mark.parametrize("words", [(), ("--help",)])
def test_the_command_alone_lists_its_verbs(piezobench: CommandLine, words: tuple[str, ...]) -> None:
    shown = piezobench.run(*words).stdout
    assert all(f"  {verb} " in shown for verb in VERBS)


def test_the_installed_script_refuses_as_the_module_does(tmp_path: Path) -> None:
    script = Path(sys.executable).with_name("piezobench")
    call = [script] if script.exists() else [sys.executable, "-m", "bench"]
    done = subprocess.run([*call, "report", "nowhere"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (
        2,
        "",
        "piezobench report: nowhere is not a run folder: it has no run.json\n",
    )


def in_bash(line: str, folder: Path) -> tuple[int, str, str]:
    """Status, output and error output of a line in which "piezobench" is a process of its own."""
    done = subprocess.run(
        ["bash", "-c", f'set -o pipefail; piezobench() {{ "$PYTHON" -m bench "$@"; }}; {line}'],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHON": sys.executable, "PYTHONPATH": os.pathsep.join(sys.path)},
    )
    return done.returncode, done.stdout, done.stderr


def test_no_process_imports_from_the_working_folder(tmp_path: Path) -> None:
    script, folder = tmp_path / "piezobench", tmp_path / "work"
    script.write_text("import bench.cli\nif __name__ == '__main__':\n    bench.cli.main()\n")
    for name in ("solvers/__init__.py", "queue.py", "quadprog.py"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(f"open({str(tmp_path / 'imported')!r}, 'w')\nraise SystemExit('of the user')\n")
    words = "race --limit 1 --set measured --solver quadprog --lane direct --budget 0.002 --name own"
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    environment.pop("PYTHONSAFEPATH", None)
    done = subprocess.run(
        [sys.executable, script, *words.split()],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, (tmp_path / "imported").exists()) == (0, False), done.stderr
    rows = pd.read_parquet(folder / "results/own/rows.parquet").query("solver == 'quadprog' and scaling == 'scaled'")
    assert (rows.status == "answered").all()


@pytest.mark.sample(1)
@pytest.mark.parametrize("words", ["problems", "problems --json", "solvers --json", "--help"])
@pytest.mark.parametrize(
    ("to", "message"),
    [
        (">&-", "standard output is closed; send it to a file, or to /dev/null"),
        ("| true", "standard output cannot be written (Broken pipe)"),
        ("> /dev/full", "standard output cannot be written (No space left on device)"),
    ],
)
def test_an_output_that_cannot_be_written_to_is_one_sentence(tmp_path: Path, words: str, to: str, message: str) -> None:
    status, shown, error = in_bash(f"piezobench {words} {to}", tmp_path)
    assert (status, shown) == (2, "")
    assert re.fullmatch(rf"piezobench( \w+)?: {re.escape(message)}\n", error)


@pytest.mark.sample(1)
@pytest.mark.parametrize("closed", ["2>&-", "<&-", "<&- 2>&-"])
def test_a_closed_error_output_or_input_changes_neither_status_nor_output(
    piezobench: CommandLine, tmp_path: Path, closed: str
) -> None:
    assert in_bash(f"piezobench problems {closed}", tmp_path)[:2] == (0, piezobench.run("problems").stdout)
    assert in_bash(f"piezobench problems --set none {closed}", tmp_path)[:2] == (2, "")


# Refusals.

OWN = "The model was fitted to this recording, so its errors say little about others."
IDENTIFY = ("identify", "stage.csv", "--out", "other.json")
COMPENSATE = ("compensate", "model.json", "path.csv", "--out", "drive.csv")
RACE = ("race", "--limit", 1, "--lane", "direct", "--solver", "daqp")
DEPLOY = ("deploy", REFERENCE, "--out", "c.json")
SIMULATED = (*DEPLOY, "--simulated")
EXCITE = ("excite", "--out", "excited.csv", "--rate")
LIVE = ("live", "--no-page", "--simulate", "duhem")
CORES = len(cores.usable())


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        # Usage.
        (["identif"], ["piezobench: No such command 'identif'. Did you mean 'identify'?; see piezobench --help"]),
        (["--fast"], ["piezobench: No such option: --fast; see piezobench --help"]),
        (["race", "--quick"], ["piezobench race: No such option: --quick; see piezobench race --help"]),
        (["race", "--limit", "some"], ["--limit"]),
        (["race", "--limit", "-1"], ["--limit"]),
        (["race", "--lane", "fast"], ["'kernel', 'direct'"]),
        (["race", "--schedule", "-1"], ["--schedule"]),
        (["race", "--rounds", "99999999999"], ["Invalid value for '--rounds'"]),
        (["race", "--time-limit", "1e9"], ["Invalid value for '--time-limit'"]),
        (["race", "--problem", "nowhere"], ["there is no problem 'nowhere'"]),
        (["resume"], ["Missing argument 'run'"]),
        (["report"], ["Missing argument 'run'"]),
        (["identify"], ["Missing argument 'recording'"]),
        (["identify", "stage.csv"], ["Missing option '--out'"]),
        (["compensate", "model.json"], ["Missing argument 'reference'"]),
        (["inspect"], ["Missing argument 'recording', or --input FILE and --output FILE"]),
        (["problems", "more"], ["more"]),
        (["problems", "--set", "paper", "--seed", "-1"], ["--seed"]),
        # Options that go with another.
        (
            ["race", "--set", "paper", "--recording", "stage.csv"],
            ["--recording is for the problem set recorded, and not for paper"],
        ),
        (["race", "--recording", "stage.csv", "--table", "two", "--sample-time", "later"], ["--sample-time"]),
        (["race", "--input", "voltage_V"], ["--input is for the problem set recorded, and not for paper and measured"]),
        (
            ["race", "--workers", 2, "--backend", "dask", "--scheduler", "tcp://here:1"],
            ["--workers is for this machine"],
        ),
        (["problems", "--limit", 2], ["--limit: needs problems; name a --set"]),
        (
            ["problems", "--set", "paper", "--folder", "."],
            ["--folder is for the problem set foreign, and not for paper"],
        ),
        (
            ["problems", "--set", "paper", "--work", 1000000000.0],
            ["--work is for the problem set foreign or test_set, and not for paper"],
        ),
        (
            ["identify", "stage.csv", "--out", "other.json", "--workers", 2],
            ["--workers: is for many recordings, with --out-dir"],
        ),
        (
            ["compensate", "model.json", "path.csv", "--out", "drive.csv", "--backend", "local"],
            ["--backend: is for many recordings, with --out-dir"],
        ),
        (
            ["validate", "model.json", "stage.csv", "--scheduler", "tcp://here:1"],
            ["--scheduler: is for many recordings, with --out-dir"],
        ),
        (
            ["deploy", "run", "--model", "model.json", "--simulated"],
            ["--simulated: selects a model of the run"],
        ),
        (["export-c", "model.json", "c", "--solver", "box_active_set"], ["--solver: is for --part learning"]),
        # Options that the recording cannot meet.
        ((*IDENTIFY, "--input", "volts"), ["stage.csv", "volts", "voltage_V"]),
        ((*IDENTIFY, "--time", "seconds"), ["stage.csv", "seconds", "time_s"]),
        ((*IDENTIFY, "--output", "voltage_V", "--input", "voltage_V"), ["stage.csv", "voltage_V"]),
        ((*IDENTIFY, "--solver", "best"), ["no solver 'best'", "box_active_set"]),
        ((*IDENTIFY, "--rates", "1,fast"), ["'1,fast'", "--rates"]),
        ((*IDENTIFY, "--creep-rates", "nan"), ["'nan' has a rate that is not positive", "--creep-rates"]),
        ((*IDENTIFY, "--n", "-1"), ["--n"]),
        ((*IDENTIFY, "--n", "many"), ["--n"]),
        ((*IDENTIFY, "--skip", "8000"), ["skip"]),
        ((*IDENTIFY, "--table", "Messung 1"), ["stage.csv", "no tables 'Messung 1'", "--table"]),
        ((*IDENTIFY, "--time", "time_s", "--sample-time", "0.01"), ["stage.csv", "time_s", "--time none"]),
        ((*IDENTIFY, "--lag", "later"), ["--lag"]),
        (
            ("inspect", "stage.csv", "--sample-rate", 1000, "--sample-time", 1),
            ["give either a positive rate or --sample-time"],
        ),
        # Damaged recordings.
        (("identify", "two.csv", "--out", "other.json"), ["two.csv", "2 "]),
        (("identify", "text.csv", "--out", "other.json"), ["text.csv", "voltage_V", "high", "data row 70"]),
        (("identify", "broken.xlsx", "--out", "other.json"), ["broken.xlsx"]),
        (("identify", "missing.csv", "--out", "other.json"), ["missing.csv"]),
        # Invalid compensation.
        (("compensate", "half.json", "path.csv", "--out", "drive.csv"), ["half.json"]),
        (("compensate", "model.json", "path.csv", "--out", "drive.xlsx"), ["drive.xlsx"]),
        ((*COMPENSATE, "--reference", "path"), ["path.csv", "path", "reference_um"]),
        ((*COMPENSATE, "--time", "seconds"), ["path.csv", "seconds"]),
        ((*COMPENSATE, "--low", "100", "--high", "50"), ["100", "50"]),
        ((*COMPENSATE, "--low", "nan"), ["nan"]),
        ((*COMPENSATE, "--rate-limit", "0"), ["--rate-limit", "positive"]),
        ((*COMPENSATE, "--rate-limit", "nan"), ["--rate-limit"]),
        ((*COMPENSATE, "--rate-limit", "1e300"), ["compensate: --rate-limit must be above 0 and below 1e+100"]),
        (
            ("compensate", "model.json", "volts.csv", "--out", "drive.csv"),
            ["volts.csv: the reference is in V, which cannot be converted to µm"],
        ),
        (
            ("simulate", "model.json", "stage.csv", "--input", "displacement_um", "--out", "output.csv"),
            ["stage.csv: the input is in µm, which cannot be converted to V"],
        ),
        (
            ("validate", "model.json", "stage.csv", "--input", "displacement_um", "--output", "voltage_V"),
            ["stage.csv: the input is in µm, which cannot be converted to V"],
        ),
        (("compensate", "model.json", "nan.csv", "--out", "drive.csv"), ["nan.csv", "data row 2"]),
        (("compensate", "model.json", "missing.csv", "--out", "drive.csv"), ["missing.csv", "no such file"]),
        ((*COMPENSATE, "--x-start", "40", "--high", "30"), ["--x-start must be within the limits of the drive"]),
        ((*COMPENSATE, "--x-start", "nan"), ["--x-start must be within the limits of the drive"]),
        ((*COMPENSATE, "--x-start", "40", "--start", "recording"), ["--x-start: is for --start rest"]),
        # Exports.
        (["export-c", "nothing.json", "c"], ["nothing.json: no such file"]),
        (["export-c", "half.json", "c"], ["is not a whole JSON file"]),
        (["export-c", "invalid.json", "c"], ["w_H[0] must be positive"]),
        (["export-c", "stage.csv", "c"], ["stage.csv: is not a whole JSON file"]),
        (["export-c", "model.json", "full"], ["holds it.fmu already; name a new or an empty folder"]),
        (["export-c", "model.json", "model.json"], ["model.json: cannot be written (Not a directory)"]),
        (["export-c", "model.json", "nowhere/c"], ["nowhere/c: cannot be written (No such file or directory)"]),
        (["export-c", "model.json", "c", "--low", 9, "--high", 1], ["the lowest drive 9 must be below the highest 1"]),
        (["export-c", "model.json", "c", "--rate-limit", 0], ["--rate-limit"]),
        (["export-c", "model.json", "c", "--name", "two words"], ["is not an identifier of C"]),
        (["export-c", "model.json", "c", "--name", "main"], ["'main' is the name of another file or function"]),
        (["export-c", "model.json", "c", "--name", "MakeFile"], ["'MakeFile' is the name of another file or function"]),
        (
            ["export-c", "model.json", "c", "--name", "compensator"],
            ["with the name 'compensator' a function could be named COMPENSATOR_KIND, as in core"],
        ),
        (["export-c", "model.json", "c", "--name", "play"], ["with the name 'play' a function could be named play_"]),
        (["export-c", "model.json", "c", "--name", "x" * 32], ["the name has 32 characters"]),
        (["export-c", "model.json", "c", "--rate-limit", "nan"], ["--rate-limit"]),
        (["export-c", "model.json", "c", "--rate", 0], ["--rate"]),
        (["export-c", "model.json", "c", "--rate", 1e300], ["'--rate': Input should be less than or equal to 1"]),
        (["export-c", "model.json", "c", "--rate-limit", "fast"], ["--rate-limit"]),
        (["export-c", "model.json", "c", "--low", "nan"], ["must be below the highest"]),
        (["export-c", "model.json", "c", "--high", "inf"], ["must be finite"]),
        (["export-c", "model.json", "c", "--part", "all"], ["--part"]),
        (["export-c", "model.json", "c", "--solver", "daqp"], ["--solver"]),
        (["export-c", "model.json", "c", "--mode", "cyclic"], ["--mode: is for --part learning"]),
        (["export-c", "model.json", "c", "--speed", "9"], ["--speed"]),
        (["export-c", "model.json"], ["folder"]),
        (["export-c", "model.json", "/proc/c"], ["/proc/c: cannot be written"]),
        (["export-c", "model.json", "c", "--precision", "half"], ["--precision"]),
        (["export-fmu", "model.json", "it.zip"], ["it.zip does not end in .fmu"]),
        (["export-fmu", "model.json", "full/it.fmu"], ["full/it.fmu already exists; name a new file"]),
        (["export-fmu", "model.json", "nowhere/it.fmu"], ["the folder nowhere does not exist"]),
        (["export-fmu", "model.json", "it.fmu", "--fmi", "4"], ["--fmi"]),
        # Outputs that cannot be written, before the work.
        *(
            ((*call[:-1], out), [message])
            for call in (IDENTIFY, COMPENSATE)
            for out, message in (
                ("nowhere/out.csv", "the folder nowhere does not exist"),
                (".", "is a folder"),
                ("/dev/null", "is not a regular file"),
                ("stage.csv/out.csv", "the folder stage.csv does not exist"),
            )
        ),
        ((*IDENTIFY, "--page", "nowhere/page.html"), ["--page"]),
        # Outputs that would replace a file that the call reads, or its other output.
        (("identify", "stage.csv", "--out", "./stage.csv"), ["--out: stage.csv is another file of this command"]),
        ((*IDENTIFY, "--page", "stage.csv"), ["--page: stage.csv is another file of this command; name a new one"]),
        ((*IDENTIFY, "--page", IDENTIFY[-1]), ["--page", "is another file of this command"]),
        (("compensate", "model.json", "path.csv", "--out", "path.csv"), ["--out: path.csv is another file"]),
        (("compensate", "model.json", "path.csv", "--out", "model.json"), ["--out: model.json is another file"]),
        (("validate", "model.json", "stage.csv", "--page", "stage.csv"), ["--page: stage.csv is another file"]),
        (("simulate", "model.json", "path.csv", "--out", "path.csv"), ["--out: path.csv is another file"]),
        (
            ("live", "--simulate", "duhem", "--reference", "path.parquet", "--record", "path.parquet"),
            ["--record: path.parquet is another file"],
        ),
        # Races.
        ((*RACE, "--solver", "best"), ["no solver 'best'", "daqp"]),
        ((*RACE, "--solver", "best.py"), ["best.py: there is no such file"]),
        ((*RACE, "--solver", "compiled.py"), ["compiled.py: is not timed inside compiled code", "its lane is direct"]),
        ((*RACE, "--set", "hard"), ["no problem set 'hard'", "paper"]),
        ((*RACE, "--name", "a/b"), ["a/b"]),
        ((*RACE, "--name", "r\udcff"), ["is not text in UTF-8"]),
        *(
            ((*RACE, "--name", name), ["the name of a run must be one line"])
            for name in ("", ".", "..", "/tmp/a", ".hidden")
        ),
        ((*RACE, "--out", "file"), ["file"]),
        ((*RACE, "--out", "/proc/results"), ["/proc/results"]),
        ((*RACE, "--out", "empty/..", "--name", "empty"), ["empty", "already exists"]),
        (
            ("race", "--lane", "kernel", "--solver", "clarabel"),
            ["no selected solver is in the lane kernel"],
        ),
        (
            ("race", "--folder", "foreign", "--budget", 0.001, "--out", "empty"),
            ["no problem of the set 'foreign' can be raced; run.json: is of an unknown format"],
        ),
        ((*RACE, "--settings", "daqp=1e-6"), ["daqp: must be SOLVER={...} with settings in JSON"]),
        ((*RACE, "--settings", "clarabel={}"), ["which does not race"]),
        (
            (*RACE, "--settings", 'daqp={"primal_tol": 1e-4}', "--settings", "daqp={}"),
            ["--settings: daqp: takes one setting, got several"],
        ),
        ((*RACE, "--backend", "dask"), ["needs the address of a scheduler"]),
        ((*RACE, "--scheduler", "tcp://here:1"), ["needs --backend dask"]),
        ((*RACE, "--backend", "cloud"), ["'local', 'dask'"]),
        ((*RACE, "--workers", "0"), ["--workers"]),
        ((*RACE, "--workers", CORES + 1), [f"{CORES + 1} workers need a core each, and this machine has {CORES}"]),
        # Sets of problems.
        (("problems", "--set", "recorded"), ["'recorded' needs --recording, a recording in any known format"]),
        (("problems", "--set", "foreign"), ["needs --folder"]),
        (("problems", "--set", "recorded", "--recording", "none.csv"), ["none.csv: no such file"]),
        (("problems", "--set", "foreign", "--folder", "nowhere"), ["nowhere: is not a folder"]),
        (("problems", "--set", "unheard"), ["there is no problem set 'unheard'; known are boxes, drift, "]),
        (("problems", "--set", "test_set", "--test-set", "empty.py"), ["has no class Empty"]),
        (("problems", "--verify"), ["needs problems; name a --set"]),
        # Drives for a recording.
        ((*EXCITE, "500", "--range", "0-100"), ["'0-100' is not two numbers in ascending order, such as 0:100"]),
        ((*EXCITE, "500", "--range", "9:1"), ["--range: '9:1' is not two numbers in ascending order"]),
        ((*EXCITE, "10", "--range", "0:1"), ["gives 600 samples, and an excitation needs 2000"]),
        ((*EXCITE, "0", "--range", "0:1"), ["must be positive, not 0"]),
        ((*EXCITE, "1e9", "--range", "0:1"), ["6e+10 samples exceed"]),
        # Many recordings at once.
        (("identify", "a.csv", "b.csv"), ["'--out' for one model of all, or '--out-dir' for one of each"]),
        (("identify", "a.csv", "--out", "m.json", "--out-dir", "models"), ["--out-dir for one of each recording"]),
        (("identify", "a.csv", "--out-dir", "models", "--page", "p.html"), ["--page"]),
        (
            ("identify", "a.csv", "a.mat", "--out-dir", "models"),
            ["a.mat: its result would have the name of that of a.csv"],
        ),
        (("identify", "s3://bucket/a.csv", "--out-dir", "models"), ["s3://bucket/a.csv: is a URL"]),
        (("identify", "a.csv", "--out-dir", "s3://bucket/models"), ["s3://bucket/models: is a URL"]),
        (("identify", "a.csv", "--out-dir", "models", "--backend", "dask"), ["--scheduler"]),
        *(
            (
                ("compensate", "model.json", "path.csv", name, "--out-dir", "."),
                [f"{name}: would be overwritten; name another --out-dir"],
            )
            for name in ("fleet.csv", "path-drive.csv")
        ),
        # Controllers on a schedule.
        (("realtime", "nothing.json"), ["nothing.json: no such file"]),
        (("realtime", "model.json", "--rate", 0), ["--rate"]),
        (("realtime", "model.json", "--seconds", "nan"), ["--seconds"]),
        (
            ("realtime", "model.json", "--rate", 1, "--seconds", 0.5),
            ["0.5 s at 1 Hz hold no sample; the shortest run is 1 s"],
        ),
        (("realtime", "model.json", "--solver", "box_active_set"), ["--solver: is for --part learning"]),
        (("realtime", "model.json", "--priority", 100), ["--priority"]),
        (("realtime", "model.json", "--core", -1), ["--core"]),
        # Live runs, before anything moves.
        (("live", "--no-page"), ["give either a simulated actuator or the file of a stage"]),
        (("live", "--no-page", "--simulate", "magic"), ["there is no simulated actuator 'magic'"]),
        (
            ("live", "--no-page", "--simulate", "flexure", "--rate", 500),
            ["the resonance at 200 Hz is above 35 % of the sampling rate, 500 Hz"],
        ),
        ((*LIVE, "--sine", "fast"), ["--sine fast: must be a frequency in Hz and an amplitude in µm"]),
        *(
            ((*LIVE, "--sine", text), ["must be a frequency in Hz and an amplitude in µm"])
            for text in ("1:2:3:4", "5Hz:10V", "1Hz:nan", "1Hz:1um:1e999")
        ),
        ((*LIVE, "--sine", "0Hz:1um"), ["the frequency must be at least 0.0001 Hz"]),
        ((*LIVE, "--sine", "1e-300Hz:1um"), ["the frequency must be at least 0.0001 Hz"]),
        ((*LIVE, "--sine", "600Hz:1um"), ["below half the sampling rate, 500 Hz"]),
        (
            (*LIVE, "--integral-gain", 1001),
            ["--integral-gain must be from 0 to 1/sample_time, 1000 per second, not 1001"],
        ),
        ((*LIVE, "--sine", "5Hz:1um", "--set-point", 3), ["give one reference"]),
        ((*LIVE, "--rate", 1e6), ["--rate': Input should be less than or equal to 10000"]),
        ((*LIVE, "--record", "run.csv"), ["must end in .parquet"]),
        ((*LIVE, "--set-point", 300), ["the set point must be a number from -20 to 20 µm, not 300"]),
        # Comparisons and decisions.
        (("compare", REFERENCE), ["two runs or more"]),
        *((("compare", REFERENCE, REFERENCE, "--smallest", no), ["a finite ratio above 1"]) for no in (1, "inf")),
        (("compare", REFERENCE, REFERENCE, "--out", REFERENCE / "c"), ["--out", "which this command reads"]),
        (("compare", "--versions", "a.py"), ["two versions are compared, A.py and B.py"]),
        (("compare", "--versions", "a.py", "a.py", "a.py"), ["two versions are compared, A.py and B.py"]),
        (("compare", "--versions", "empty.py", "empty.py"), ["empty.py: must define one Solver class"]),
        (("compare", "--versions", "empty.py", "empty.py", "--out", "c"), ["is for runs"]),
        (("compare", "a.py", "a.py", "--set", "measured"), ["needs --versions"]),
        ((*SIMULATED, "--accuracy", 1e-60), ["has a cost gap or violation above 1e-60 on"]),
        ((*SIMULATED, "--deadline", 1), ["no solver qualifies; the nearest, "]),
        ((*SIMULATED, "--lane", "cvxpy"), ["no solver qualifies; the nearest, "]),
        ((*SIMULATED, "--deadline", 0.001), ["a solver that does nothing misses"]),
        ((*SIMULATED, "--problem", "paper/none"), ["has no problem 'paper/none'; there are "]),
        (DEPLOY, ["holds no model of your actuator; give one with --model"]),
        (
            (*DEPLOY, "--problem", "paper/duhem-staircase"),
            ["is a simulated actuator; give a model with --model, or --simulated"],
        ),
        *(
            ((*SIMULATED[:-2], out, "--simulated"), [f"--out: {out} is in {REFERENCE}, which this command reads"])
            for out in (REFERENCE / "run.json", REFERENCE / "misses" / "new.json")
        ),
        # Folders that are no run.
        *(
            ((verb, name), [name])
            for verb in ("report", "resume")
            for name in ("missing", "empty", "file", "foreign", "broken")
        ),
    ],
    ids=str,
)
@pytest.mark.usefixtures("identified")
def test_an_invalid_call_is_refused_in_one_sentence_and_changes_no_file(
    desk: Path, words: tuple[object, ...], parts: list[str]
) -> None:
    sentence = refused(in_process, desk, *words)
    assert all(part in sentence for part in parts), sentence
    assert Path("/dev/null").is_char_device()


# Where results go.


@pytest.mark.parametrize(
    ("words", "out", "largest_file", "message"),
    [
        (("identify", "stage.csv", "--out"), "out.csv", 1000, r"out\.csv.*File too large"),
        (("compensate", "model.json", "path.csv", "--out"), "out.csv", 1000, r"out\.csv.*File too large"),
        (("export-c", "model.json"), "c", 2000, "cannot be written"),
        (("export-fmu", "model.json"), "it.fmu", 3000, r"\w: File too large"),
    ],
    ids=lambda each: each[0] if isinstance(each, tuple) else "",
)
def test_a_disk_that_is_full_leaves_the_old_output_as_it_was_and_no_half_written_folder_or_file(
    piezobench: CommandLine,
    desk: Path,
    identified: None,
    tmp_path: Path,
    words: tuple[str, ...],
    out: str,
    largest_file: int,
    message: str,
) -> None:
    for name in ("stage.csv", "path.csv", "model.json"):
        shutil.copy(desk / name, tmp_path)
    (tmp_path / "out.csv").write_text("old")
    assert re.search(message, refused(piezobench, tmp_path, *words, out, largest_file=largest_file))


# Races.


def test_an_unfinished_race_is_resumed_before_its_report_and_with_its_solver_files(
    piezobench: CommandLine, clean_race: Race, tmp_path: Path
) -> None:
    clean_race.unfinished(tmp_path / "run", solver_files=[str(tmp_path / "gone.py")])
    assert "resume it" in refused(piezobench, tmp_path, "report", "run")
    assert "gone.py: there is no such file" in refused(piezobench, tmp_path, "resume", "run", "--solver", "gone.py")


def test_a_race_whose_limit_cut_a_set_says_how_to_race_all_and_one_on_named_problems_does_not(
    piezobench: CommandLine, clean_race: Race, tmp_path: Path
) -> None:
    said = "1 of 15 problems were raced; --limit 0 races all."
    assert said in clean_race.call.stdout
    named = clean_race.copied(tmp_path / "named", settings={"limit": 0, "problems": [clean_race.rows.problem.iloc[0]]})
    assert said not in piezobench("report", named.path).stdout


def test_every_problem_set_is_listed_with_its_size_and_purpose(piezobench: CommandLine) -> None:
    listed = piezobench("problems").stdout
    for name, made in all_sets().items():
        size = rf"needs --{'.*'.join(made.needs).replace('_', '-')}" if made.needs else len(made().names())
        assert re.search(rf"^{name} +{size} +{re.escape(made.description)}", listed, re.MULTILINE)


# From a recording to a drive.


def test_the_compensated_drive_follows_the_reference_better_than_a_straight_line(
    piezobench: CommandLine, desk: Path, identified: None
) -> None:
    call = piezobench.quietly("compensate", "model.json", "path.csv", "--out", "drive.csv", folder=desk)
    assert re.search(r"of the reference(.|\n)*\nDrive: drive\.csv\n$", call.stdout)
    drive, wanted = pd.read_csv(desk / "drive.csv"), pd.read_csv(desk / "path.csv").reference_um
    assert [*drive] == ["time_s", "drive_V"]
    np.testing.assert_allclose(drive.time_s.diff()[1:], SAMPLE_TIME)
    plant = actuator()
    assert drive.drive_V.between(*plant.x_range).all()
    # after the initial ramp from rest
    assert np.std((plant.run(drive.drive_V) - wanted)[2000:]) < 0.01 * np.ptp(wanted)


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_validate_says_if_the_model_was_fitted_to_the_recording_itself_whatever_its_file(
    piezobench: CommandLine, desk: Path, identified: None, tmp_path: Path, suffix: str
) -> None:
    t, x, y = np.loadtxt(desk / "stage.csv", delimiter=",", skiprows=1, unpack=True)
    write_table(tmp_path / f"copy.{suffix}", {"t_s": t, "voltage_V": x, "displacement_um": y})
    words = ("validate", desk / "model.json", f"copy.{suffix}", "--page", "copy.html")
    assert OWN in piezobench.quietly(*words, folder=tmp_path).stdout
    assert OWN in (tmp_path / "copy.html").read_text()
    assert json.loads(piezobench(*words, "--json", folder=tmp_path).stdout)["own"] is True
