"""Many recordings at once: on several workers, killed and resumed, on a cluster."""

import json
import os
import shutil
import signal
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command_line import Call, CommandLine, Finished, kill_worker, wait_until
from recording_files import text_file
from small_races import TWO_CORES

from bench.cli.fleet import process
from bench.fleet.fleet import items_of, run_all
from bench.fleet.jobs import Compensating, Identifying, Validating
from bench.messages.task import silent
from bench.processes.engine import Workers
from piezo_model import HysteresisCreepModel, plants
from piezo_model.recordings import RecordingError, write_table
from piezo_model.signals import multi_sine

SAMPLE_TIME = 1e-3
COUNT, NOISY, BAD = 7, "stage5", "torn"
ORDERS = ("--n", 3, "--m", 1)


def table_in(folder: Path) -> pd.DataFrame:
    table = pd.read_csv(folder / "fleet.csv", dtype={"refused": str})
    return table.assign(refused=table.refused.fillna(""))


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Recordings of similar actuators, one with a poor sensor, and a truncated file."""
    folder, chance = tmp_path_factory.mktemp("<i>recordings"), np.random.default_rng(5)
    x = multi_sine(duration_s=3.0, sample_time=SAMPLE_TIME, low=0.0, high=150.0, highest_Hz=10.0)
    clean = plants.get("relay_preisach", sample_time=SAMPLE_TIME).run(x)
    found = [folder / f"stage{i}.{('csv', 'parquet')[i % 2]}" for i in range(COUNT)]
    for path in found:
        y = chance.uniform(0.9, 1.1) * clean + chance.normal(0.0, 0.5 if path.stem == NOISY else 0.05, x.size)
        write_table(path, {"time_s": np.arange(x.size) * SAMPLE_TIME, "voltage_V": x, "displacement_um": y})
    torn = folder / f"{BAD}.csv"
    torn.write_text(found[0].read_text()[:200])
    return [*found[:3], torn, *found[3:]]


@pytest.fixture(scope="module")
def serial(piezobench: CommandLine, recordings: list[Path]) -> tuple[Path, Finished]:
    """Folder of a run in one process, and its result."""
    out = recordings[0].parent.parent / "<u>models"
    return out, piezobench("identify", *recordings, "--out-dir", out, *ORDERS)


def kept_files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.glob("*.json")}


def assert_same(serial: Path, other: Path) -> None:
    pd.testing.assert_frame_equal(table_in(serial), table_in(other))
    assert kept_files(serial) == kept_files(other)
    assert not list(other.rglob(".*"))  # nothing half-written


def test_a_bad_file_affects_only_its_own_row(
    piezobench: CommandLine, serial: tuple[Path, Finished], recordings: list[Path], tmp_path: Path
) -> None:
    out, call = serial
    assert call.refusal == (
        f"piezobench identify: 1 of {COUNT + 1} recordings is refused; the table {out}/fleet.csv says why"
    )
    assert f"{COUNT} of {COUNT + 1} recordings gave a model." in call.stdout
    table = table_in(out)
    assert table.refused[0].startswith(f"{BAD}.csv: ")
    # the refused one, and the largest error
    assert (*table.name[:2], *set(table.refused[1:])) == (BAD, NOISY, "")
    assert table.rms_percent[1] > 2.0 * table.rms_percent[2:].max()
    assert not (out / f"{BAD}.json").exists()
    piezobench.run("identify", recordings[0], "--out", tmp_path / "alone.json", *ORDERS)
    assert (tmp_path / "alone.json").read_bytes() == (out / f"{recordings[0].stem}.json").read_bytes()
    model = HysteresisCreepModel.load(tmp_path / "alone.json")
    row = table.set_index("name").loc[recordings[0].stem]
    assert row.rms_percent == pytest.approx(model.report["fit"]["rms_percent"], rel=1e-14)
    assert row[[*model.structure.weight_names]].tolist() == pytest.approx(model.weights.tolist(), rel=1e-14)


@pytest.mark.slow
def test_finished_work_is_kept_unless_settings_or_content_change(recordings: list[Path], tmp_path: Path) -> None:
    chosen = [Path(shutil.copy(path, tmp_path)) for path in recordings[:2]]

    def written(work: Identifying) -> list[int]:
        """Indices of the models that were written."""
        before = [path.stat().st_ino if path.exists() else 0 for path in models]
        items = list(items_of(work, list(map(str, chosen)), tmp_path / "out"))
        assert [row["refused"] for row in run_all(items, map, silent)] == ["", ""]
        return [i for i, path in enumerate(models) if path.stat().st_ino != before[i]]

    models = [tmp_path / "out" / f"{path.stem}.json" for path in chosen]
    first, other = (Identifying(options={"n": 2, "m": m, "creep_rates": ()}) for m in (0, 1))
    for work, expected, then in (
        (first, [0, 1], lambda: None),
        (first, [], lambda: chosen[1].write_bytes(recordings[5].read_bytes())),
        (first, [1], models[0].unlink),
        (first, [0], lambda: None),
        (other, [0, 1], lambda: None),
    ):
        assert written(work) == expected
        then()


@pytest.mark.slow
def test_a_product_that_was_truncated_or_changed_is_made_again(recordings: list[Path], tmp_path: Path) -> None:
    """Covers a model, a drive, and a validation, which only has a row."""
    recording, out = str(recordings[0]), tmp_path / "out"
    reference, name = tmp_path / "wanted.csv", recordings[0].stem
    write_table(reference, {"time_s": np.arange(200) * SAMPLE_TIME, "reference_um": np.zeros(200)})
    model = out / f"{name}.json"
    for work, given, made in (
        (Identifying(options={"n": 2, "m": 0, "creep_rates": ()}), recording, model),
        (Compensating(str(model)), str(reference), out / "wanted-drive.csv"),
        (Validating(str(model)), recording, tmp_path / "judged" / "rows" / model.name),
    ):
        parts = list(items_of(work, [given], tmp_path / "judged" if isinstance(work, Validating) else out))
        (row,) = run_all(parts, map, silent)
        assert row["refused"] == ""
        whole = made.read_bytes()
        for damaged in (whole[: len(whole) // 2], b"", b"{}", whole + b" 1"):
            made.write_bytes(damaged)
            assert (run_all(parts, map, silent), made.read_bytes()) == ([row], whole)


def test_a_repeated_fleet_deletes_no_model_of_a_recording_that_is_gone_and_names_it_as_not_of_this_run(
    piezobench: CommandLine, recordings: list[Path], tmp_path: Path
) -> None:
    chosen = [Path(shutil.copy(path, tmp_path)) for path in recordings[:3]]
    out = tmp_path / "models"
    words = ("--out-dir", out, "--n", 2, "--m", 0, "--rates", "none")
    out.mkdir()
    (out / "torn.json").write_text("my own")  # a user's file with the name of a product
    piezobench.run("identify", *chosen, *words)
    before = kept_files(out)
    chosen[1].unlink()
    call = piezobench("identify", *chosen[:2], text_file(tmp_path, "no numbers", name="torn.csv"), *words)
    assert "2 of 3 recordings are refused" in call.refusal
    assert kept_files(out) == before
    assert "Not of this run, but in the folder: stage1.json, stage2.json and torn.json." in call.stdout
    refused = table_in(out).set_index("name").refused != ""
    assert refused.to_dict() == {"stage0": False, "stage1": True, "torn": True}
    found = json.loads(piezobench("identify", chosen[0], *words, "--json").stdout)
    assert found["not_of_this_run"] == ["stage1.json", "stage2.json", "torn.json"]
    chosen[1].write_bytes(recordings[1].read_bytes())
    piezobench.run("identify", *chosen, *words)
    assert kept_files(out) == before


def three_done(folder: Path) -> bool:
    """Whether the rows of three recordings are there, at least."""
    return len(list(folder.glob("rows/[!.]*.json"))) >= 3


AGAIN = "finished recordings are kept; run the same command to continue"
LOST = f"piezobench identify: {{}}: a worker was killed, perhaps for lack of memory; {AGAIN}"


@TWO_CORES
@pytest.mark.slow
@pytest.mark.parametrize(
    ("end", "status", "said"),
    [
        pytest.param(Call.kill_once, -signal.SIGKILL, "", id="SIGKILL"),
        *(
            pytest.param(partial(Call.kill_once, number=number), 128 + number, f"Interrupted; {AGAIN}.", id=number.name)
            for number in (signal.SIGTERM, signal.SIGINT)
        ),
        pytest.param(kill_worker, 2, LOST, id="the loss of a worker"),
    ],
)
def test_a_fleet_that_was_ended_is_resumed_without_loss_or_repetition(
    piezobench: CommandLine,
    recordings: list[Path],
    tmp_path: Path,
    serial: tuple[Path, Finished],
    end: Callable[[Call, Callable[[], bool]], Finished],
    status: int,
    said: str,
) -> None:
    words = ("identify", *recordings, "--out-dir", tmp_path, *ORDERS)
    ended = end(piezobench.start(*words, "--workers", 2), lambda: three_done(tmp_path))
    first_line = "".join(ended.stderr.splitlines()[:1])
    assert (ended.status, first_line, (tmp_path / "fleet.csv").exists()) == (status, said.format(tmp_path), False)
    kept = {path: path.stat().st_ino for path in tmp_path.glob("rows/[!.]*.json")}
    assert 3 <= len(kept) <= COUNT
    for path in tmp_path.rglob(".*"):  # temporary files of the killed process
        path.unlink()
    assert piezobench(*words).status == 2
    assert {path: path.stat().st_ino for path in kept} == kept
    assert_same(serial[0], tmp_path)


@TWO_CORES
def test_a_cluster_that_loses_a_worker_gives_the_rows_of_a_serial_run(
    piezobench: CommandLine, recordings: list[Path], tmp_path: Path, serial: tuple[Path, Finished], scheduler: str
) -> None:
    from distributed import Client

    with Client(scheduler, timeout="60s") as client:
        first, *_ = client.run(os.getpid).values()
        call = piezobench.start(
            "identify", *recordings, "--out-dir", tmp_path, *ORDERS, "--backend", "dask", "--scheduler", scheduler
        )
        wait_until(lambda: three_done(tmp_path), call.stderr.read_text)
        os.kill(first, 9)
        assert call.wait().status == 2, call.stderr.read_text()
        client.wait_for_workers(2, timeout=60)
        assert first not in client.run(os.getpid).values()
    for path in tmp_path.rglob(".*"):
        path.unlink()
    assert_same(serial[0], tmp_path)


def test_each_recording_is_judged_and_each_reference_followed_by_the_model_of_its_name(
    piezobench: CommandLine, recordings: list[Path], tmp_path: Path, serial: tuple[Path, Finished]
) -> None:
    models, chosen = serial[0], recordings[:2]
    stranger = shutil.copy(recordings[0], tmp_path / "stranger.csv")
    call = piezobench("validate", models, *chosen, stranger, "--out-dir", tmp_path / "judged")
    assert "1 of 3 recordings is refused" in call.refusal
    own = "Judged on the recording that the model was fitted to, which says little about others"
    other = piezobench.run("validate", models / "stage0.json", recordings[1], "--out-dir", tmp_path / "others")
    assert [f"{own}: 2." in call.said, own in other.said] == [True, False]
    judged = table_in(tmp_path / "judged").set_index("name")
    assert judged.refused["stranger"] == f"{models / 'stranger.json'}: no such file"
    for path in chosen:
        alone = json.loads(piezobench("validate", models / f"{path.stem}.json", path, "--json").stdout)
        row = judged.loc[path.stem]
        assert (row.rms_percent, row["shift"]) == (alone["fit"]["rms_percent"], alone["shift"])

    references = [tmp_path / f"{path.stem}.csv" for path in chosen]
    for height, path in enumerate(references):
        write_table(
            path,
            {"time_s": np.arange(500) * SAMPLE_TIME, "reference_um": (3.0 + height) * np.sin(0.05 * np.arange(500))},
        )
    for model, others in (
        (models, [models / f"{path.stem}.json" for path in chosen]),
        (models / "stage0.json", [models / "stage0.json"] * 2),
    ):
        piezobench.quietly("compensate", model, *references, "--out-dir", tmp_path / "drives")
        for other, path in zip(others, references, strict=True):
            piezobench.run("compensate", other, path, "--out", tmp_path / "alone.csv")
            alone = (tmp_path / "alone.csv").read_bytes()
            assert (tmp_path / "drives" / f"{path.stem}-drive.csv").read_bytes() == alone
    call = piezobench("compensate", models, *references, "--x-start", -900, "--out-dir", tmp_path / "outside")
    assert "2 of 2 recordings are refused" in call.refusal
    assert list(table_in(tmp_path / "outside").name) == [path.stem for path in references]
    assert "--x-start must be within the limits of the drive" in call.said


@pytest.mark.slow
def test_the_first_screen_has_a_hundred_columns_and_forty_lines_however_many_fail(
    recordings: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = [text_file(tmp_path, "no numbers in here", name=f"{i}-{'x' * 50}.csv") for i in range(60)]
    with pytest.raises(RecordingError, match=f"60 of {60 + COUNT} recordings are refused"):
        process(
            Identifying(options={"n": 1, "m": 0, "creep_rates": ()}),
            [*map(str, broken), *(str(path) for path in recordings if path.stem != BAD)],
            str(tmp_path / "out"),
            Workers(),
            "gave a model",
            as_json=False,
        )
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= 40
    assert max(map(len, lines[:-1])) <= 100  # the last names the folder
