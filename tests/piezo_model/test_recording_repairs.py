"""Ordinary laboratory dirt is repaired and named, or questioned; a spoiled file is refused."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plain_stage import stage
from recording_files import refusal

from piezo_model.recordings import Recording, RecordingError, write_table

N, PERIOD = 2000, 0.005
T = np.arange(N) * PERIOD
X = 1.0 + 4.0 * (1.0 - np.cos(2 * np.pi * 0.5 * T))
Y = stage(X)
HEADER = ("time_s", "voltage_V", "position_um")


def table(
    *columns: np.ndarray, header: tuple[str, ...] = HEADER, separator: str = ",", decimal: str = ".", digits: int = 7
) -> str:
    rows = (separator.join(f"{v:.{digits}g}" for v in row).replace(".", decimal) for row in zip(*columns, strict=True))
    return "\n".join(([separator.join(header)] if header else []) + [*rows]) + "\n"


def changed(values: np.ndarray, at: int | list[int] | slice, value: Any = np.nan) -> np.ndarray:
    """A copy with some values replaced."""
    copy = values.copy()
    copy[at] = value
    return copy


def opened(folder: Path, text: str, **options: Any) -> Recording:
    (folder / "stage.csv").write_text(text, encoding="utf-8")
    return Recording.open(folder / "stage.csv", **options)


CLEAN = table(T, X, Y)
SLOW = np.argsort(X, kind="stable")
REPAIRED: dict[str, tuple[str, str, slice, int]] = {
    # text, remark, rows that are cut out, number of rows that are not counted
    "an empty cell": (CLEAN.replace(f",{Y[7]:.7g}\n", ",\n"), "position_um' is missing in row 9", slice(0), 1),
    "NaN, decimal commas": (
        table(T, X, changed(Y, [5, 900]), separator=";", decimal=","),
        "is missing in row 7 .data row 6., row 902",
        slice(0),
        2,
    ),
    "a silent sensor": (
        table(T, X, changed(Y, slice(300, 1200))),
        "900 of 2000 samples are interpolated",
        slice(0),
        900,
    ),
    "a drive that is missing": (
        table(T, changed(X, slice(50, 58)), Y),
        "voltage_V' is missing in row 52 .*: 8 of 2000 samples are interpolated",
        slice(0),
        8,
    ),
    "overloads": (table(T, X, changed(Y, slice(100, 104), 9.9e37)), r"is 9\.9e\+37 in row 102", slice(0), 4),
    "an oscilloscope's sign beyond its range": (
        CLEAN.replace(f",{Y[7]:.7g}\n", ",∞\n"),
        "missing in row 9",
        slice(0),
        1,
    ),
    "an infinite drive": (table(T, changed(X, 100, np.inf), Y), "is infinite in row 102", slice(0), 1),
    "the last sample of the drive": (table(T, changed(X, 1999, 7.7), Y), "voltage_V' is 7.7 in row 2001", slice(0), 1),
    "the first sample of the sensor": (
        table(T, X, changed(Y, 0, -500.0)),
        "is -500 in row 2 .* isolated bad",
        slice(0),
        1,
    ),
    "two bad samples, tabs": (
        table(T, changed(X, 400, 99.0), changed(Y, 1200, 0.0), separator="\t"),
        "voltage_V' is 99 in row 402 .* next to",
        slice(0),
        2,
    ),
    "a logger quicker than its clock": (
        table(np.repeat(T, 3), np.repeat(X, 3), np.repeat(Y, 3)),
        "4000 of 6000 rows repeat the time",
        slice(0),
        0,
    ),
    "a long pause": (table(T + 3.0 * (T > 6), X, Y), "1 pause in its times, before row 120[23]", slice(0), 0),
    "a gap of 90 rows": (
        table(*(np.delete(values, slice(1500, 1590)) for values in (T, X, Y))),
        "1 pause in its times, before row 1502",
        slice(1500, 1590),
        0,
    ),
    "a sensor that writes every fourth row": (
        table(T[:1997], X[:1997], np.where(np.arange(1997) % 4, np.nan, Y[:1997])),
        "1497 of 1997 samples are interpolated",
        slice(1997, N),
        1497,
    ),
    "a sensor that is held": (
        table(T, X, np.repeat(Y[::4], 4)),
        "holds each value for 4 rows, as of a sensor slower than the drive: 1500 of 2000",
        slice(0),
        1500,
    ),
    "a row cut off": (CLEAN + "10.0,1", "incomplete lines at the end are left out: 1", slice(0), 0),
    "a row without its last cell": (CLEAN + "10.0,1,", "incomplete rows at the end are left out: 1", slice(0), 0),
}


@pytest.mark.parametrize("kind", REPAIRED)
def test_a_repair_is_named_with_its_row_and_refused_if_strict(tmp_path: Path, kind: str) -> None:
    text, remark, cut, uncounted = REPAIRED[kind]
    recording = opened(tmp_path, text)
    assert re.search(remark, "; ".join(recording.remarks))
    assert all(f"Note: {remark}." in recording.describe() for remark in recording.remarks)
    assert (recording.sample_time, np.count_nonzero(recording.uncounted)) == (PERIOD, uncounted)
    counted, x, y = ~recording.uncounted, *(np.delete(values, cut) for values in (X, Y))
    np.testing.assert_allclose([recording.x[counted], recording.y[counted]], [x[counted], y[counted]], rtol=1e-6)
    np.testing.assert_allclose(recording.x, x, atol=0.1)  # bad ones are replaced before the operators see them
    with pytest.raises(RecordingError, match="without --strict"):
        opened(tmp_path, text, strict=True)
    assert opened(tmp_path, CLEAN, strict=True).remarks == ()


SHUFFLED = np.random.default_rng(0).permutation(N)
SPOILED: dict[str, tuple[str, dict[str, Any], str]] = {
    "shuffled rows": (table(T[SHUFFLED], X[SHUFFLED], Y[SHUFFLED]), {}, "backwards .* s; sort the rows by time"),
    "sorted rows without times": (table(X[SLOW], Y[SLOW], header=HEADER[1:]), {"sample_time": 1e-3}, "order in time"),
    "sorted by the sensor": (
        table(*(v[np.argsort(-Y)] for v in (X, Y)), header=HEADER[1:]),
        {"sample_time": 1e-3},
        "only falls while the other signal",
    ),
    "stamps that repeat and values that do not": (
        table(np.repeat(1.0371 * T[::4], 4), X, Y),
        {},
        "0 s from row 2 .* to row 3",
    ),
    "a sensor silent for more than half": (table(T, X, changed(Y, slice(300, 1400))), {}, "in all 1100 of 2000 values"),
    "a drive with holes everywhere": (
        table(T, changed(X, slice(0, N)) + (T % 0.1 < 0.04), Y),
        {},
        "cannot tell which column is the input",
    ),
    "a drive that is missing for long": (
        table(T, changed(X, slice(700, 712)), Y),
        {},
        "missing in row 702 .* 12 of 2000 .*; --from and --to read the rows before or after",
    ),
    "a drive that begins late": (table(T, changed(X, 0), Y), {}, "missing in row 2 .*; --from and --to"),
    "a drive missing here and there": (table(T, np.where(np.arange(N) % 40, X, np.nan), Y), {}, "in all 50 of 2000"),
    "an overload for more than half": (
        table(T, X, changed(Y, slice(300, 1400), 9.9e37)),
        {},
        "is 9.9e.37 in row 302 .*, which is too large for a measured value; in all 1100 of 2000",
    ),
    "times that are missing": (table(changed(T, 40), X, Y), {}, "time_s' is missing in row 42"),
    "a time that jumps": (table(changed(T, 40, 3.0), X, Y), {}, "runs backwards in row 43"),
    "rows sorted by the drive": (table(T[SLOW], X[SLOW], Y[SLOW]), {}, "backwards in row .*; sort the rows by time"),
    "rows in falling time": (table(T[::-1], X[::-1], Y[::-1]), {}, "runs backwards in row 3 .*; sort the rows by time"),
    "a short gap": (table(T + 0.02 * (T > 6), X, Y), {}, "0.025 s from row 120[12] .* to row 120[23]"),
    "sweeps at two rates": (
        table(T, X, Y) + table(T * 2, X, Y),
        {},
        "has two sampling rates: one sample every 0.005 s at its start and one every 0.01 s at its end",
    ),
    "a rate that halves midway": (
        table(np.where(T < 5.0, T, 2.0 * T - 5.0), X, Y),
        {},
        "has two sampling rates: one sample every 0.005 s at its start and one every 0.01 s at its end",
    ),
    "a sweep of three rows": (table(changed(T, slice(1997, None), T[:3]), X, Y), {}, "runs backwards"),
    "a stray text": (CLEAN.replace(f",{X[50]:.7g},", ",over,", 1), {}, "holds 'over' in row"),
    "an open quote": (CLEAN.replace(f",{X[50]:.7g},", ',"1,', 1), {}, "row 52|quote"),
    "a row too wide": (CLEAN.replace(f",{X[50]:.7g},", ",1,1,", 1), {}, "has 4 columns where the others have 3"),
    "lost decimal marks of the drive": (table(T, X * 1e6, Y), {}, "reaches from .* V, more than 10000 V"),
    "lost decimal marks of the sensor": (table(T, X, Y * 1e6), {}, "a decimal mark missing, or the unit wrong"),
    "a gap beside a few rows": (
        table(*(np.delete(values, slice(8, 98)) for values in (T, X, Y))),
        {"resample": PERIOD},
        "has a gap before row 10 .* exclude these rows with --from or --to",
    ),
    "lost decimal marks of the times": (table(np.round(T * 1e6), X, Y, digits=12), {}, "one sample every 5000 s; is a"),
    "a resampling by mistake": (CLEAN, {"resample": 1e-6}, "makes 9995001 samples of 2000 rows"),
    "no rows in a part": (CLEAN, {"from_s": 50.0}, "has 0 rows between --from 50 and --to inf"),
    "a period that the clock contradicts": (CLEAN, {"sample_time": 0.1}, "has one sample every 0.005 s, and --sample"),
    "a length for a unit of time": (table(T, X, Y), {"time_unit": "um"}, "'um', .* of time; --time-unit"),
    "a zero byte": (CLEAN.replace("time_s", "t\0ime_s"), {}, "is none of these: a Parquet file"),
    "a name that two columns have": (
        table(T, X, Y, header=("Sec", "Volt", "Volt")),
        {"input": "Volt"},
        r"2 columns named 'Volt'; .* 2 for 'Volt \(2\)', 3 for 'Volt \(3\)'",
    ),
}


@pytest.mark.parametrize("kind", SPOILED)
def test_a_spoiled_file_is_refused(tmp_path: Path, kind: str) -> None:
    text, options, sentence = SPOILED[kind]
    (tmp_path / "stage.csv").write_text(text)
    assert re.search(sentence, refusal(tmp_path / "stage.csv", **options))


@pytest.mark.parametrize(
    ("drive", "sensor"),
    [
        (changed(X, [300, 700, 1100, 1500], 20.0), Y),  # a train of pulses
        (changed(X, slice(900, 950), 30.0), changed(Y, slice(900, 950), 900.0)),  # a step and its way back
        (changed(X, 900, 30.0), changed(Y, 900, 900.0)),  # which the sensor answers
        (np.where(T % 1 < 0.5, 1.0, 9.0), np.where(T % 1 < 0.5, 41.5, 366.0)),
        (X, Y + np.random.default_rng(1).normal(0, 30, N)),
    ],
    ids=["pulses", "step", "answered", "square wave", "noise"],
)
def test_real_jumps_are_no_bad_samples(tmp_path: Path, drive: np.ndarray, sensor: np.ndarray) -> None:
    assert opened(tmp_path, table(T, drive, sensor), input_unit="V").remarks == ()


SWEEP, HALF = slice(0, 1000), table(T[:1000], X[:1000], Y[:1000])
PARTS = {
    "each with its header": f"# sweep\n{HALF}\n# sweep\n{HALF}",
    "numbered headings": f"Sweep 1 of 2\n{HALF}\nSweep 2 of 2\n{HALF}",
    "without a header between": table(np.tile(T[SWEEP], 2), np.tile(X[SWEEP], 2), np.tile(Y[SWEEP], 2)),
    "another start": HALF + table(T[SWEEP] + 1.0, X[SWEEP], Y[SWEEP]),
    "semicolons": 2 * table(T[SWEEP], X[SWEEP], Y[SWEEP], separator=";", decimal=","),
}


@pytest.mark.parametrize("kind", PARTS)
def test_sweeps_below_each_other_are_parts(tmp_path: Path, kind: str) -> None:
    recording = opened(tmp_path, PARTS[kind])
    assert (recording.length, recording.starts, recording.sample_time) == (N, (0, 1000), PERIOD)
    np.testing.assert_allclose([recording.x, recording.y], np.tile([X[SWEEP], Y[SWEEP]], 2), rtol=1e-6)
    assert "2 parts: the times start again" in recording.describe()
    assert opened(tmp_path, PARTS[kind], from_s=1.0, to_s=2.0).parts == [slice(0, 201), slice(201, 402)]
    finer = Recording.open(tmp_path / "stage.csv", resample=PERIOD / 4)
    assert (finer.length, finer.starts, finer.y[3997]) == (2 * 3997, (0, 3997), recording.y[0])


@pytest.mark.parametrize(("along", "time"), [(0, "vector"), (1, "vector"), (0, "column")])
def test_a_batch_is_read_along_the_axis_of_its_times(tmp_path: Path, along: int, time: str) -> None:
    x, y = (np.reshape(values, (20, 100)) for values in (X, Y))
    t = T[:100] if time == "vector" else T[:100, None]
    turned = [array.T if along and array.shape == x.shape else array for array in (t, x, y)]
    np.savez(tmp_path / "batch.npz", **dict(zip(("time", "voltage", "displacement"), turned, strict=True)))
    recording = Recording.open(tmp_path / "batch.npz")
    np.testing.assert_array_equal([recording.x, recording.y], [X, Y])
    assert (recording.starts, recording.sample_time) == (tuple(range(0, N, 100)), PERIOD)


def scope(channel: str, values: np.ndarray, unit: str = "V") -> str:
    """A channel of an oscilloscope whose settings stand beside the first rows."""
    settings = ["Record Length,2000", "Source," + channel, "Vertical Units," + unit, "Horizontal Units,s", "Probe,1"]
    beside = [*settings, *[","] * (N - len(settings))]
    return "\n".join(f"{a},,{t:.9f},{v:.5e}," for a, t, v in zip(beside, T - 0.25, values, strict=True)) + "\n"


def test_two_channels_of_an_oscilloscope_beside_each_other_are_one_recording(tmp_path: Path) -> None:
    pair = (scope(channel, values).splitlines() for channel, values in (("CH1", X), ("CH3", Y)))
    text = "\n".join(",".join(lines) for lines in zip(*pair, strict=True)) + "\n"
    recording = opened(tmp_path, text, input="CH1", output="CH3")
    assert recording.columns == {"time": "Time (4)", "input": "CH1", "output": "CH3"}
    assert (recording.input_unit, recording.output_unit, recording.length) == ("V", "V", N)


def test_two_files_are_one_recording(tmp_path: Path) -> None:
    files = {
        "u.csv": scope("CH1", X),
        "y.csv": scope("CH3", Y, "mV"),
        "late.csv": table(T[:1800] + 0.5025, Y[:1800], header=("t_s", "b")),
        "bare.csv": table(Y, header=()),
        "pair.csv": table(T - 0.25, X, Y, header=("s", "drive", "sensor")),
        "other.csv": table(T + 99.0, Y, header=("t_s", "b")),
        "sweeps.csv": table(np.tile(T[:1000], 2), Y[:2000], header=("t_s", "b")),
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    u, y, late, bare, pair, other, sweeps = (str(tmp_path / name) for name in files)
    joined = Recording.open(input=u, output=y)
    assert (joined.input_unit, joined.output_unit, joined.sample_time, joined.remarks) == ("V", "mV", PERIOD, ())
    np.testing.assert_allclose(
        [joined.x, joined.y, Recording.open(input=u, output=f"{pair}:sensor").y], [X, Y, Y], rtol=1e-5
    )
    assert Recording.open(input=bare, output=bare, sample_time=1e-3).length == N
    for output, sentence in (
        (late, "have 2000 and 1800 rows, or different times"),
        (other, "have 2000 and 2000 rows, or different times"),
        (sweeps, "or different times; two files are one recording if each row"),
        ("absent.csv", "no such file"),
        (None, "--input FILE and --output FILE"),
    ):
        with pytest.raises(RecordingError, match=sentence):
            Recording.open(input=u, output=output)


@pytest.mark.parametrize(
    ("header", "options", "columns", "units"),
    [
        ("Zeit,Soll,Ist\n[ms],[Digits],[V]", {}, ("Zeit", "Soll", "Ist"), ("Digits", "V")),
        ("Time,Command,Position\ns,raw,um", {}, ("Time", "Command", "Position"), ("raw", "um")),
        ("x-axis,1,2\nsecond,Volt,Volt", {"input": "2", "output": "3"}, ("second", "Volt (2)", "Volt (3)"), ("", "")),
        ("Sec,Volt,Volt", {"input": "2", "output": "Volt (3)"}, ("Sec", "Volt (2)", "Volt (3)"), ("", "")),
        ("time_s,drive\x1a_V,sensor\x07_V", {"input": "drive"}, ("time_s", "drive_V", "sensor_V"), ("V", "V")),
    ],
)
def test_names_are_printable_told_apart_and_found_by_a_part(
    tmp_path: Path, header: str, options: dict[str, str], columns: tuple[str, ...], units: tuple[str, str]
) -> None:
    recording = opened(tmp_path, table(T, X, Y).replace(",".join(HEADER), header, 1), **options)
    assert (*recording.columns.values(), recording.input_unit, recording.output_unit) == (*columns, *units)
    assert recording.describe().replace("\n", "").isprintable()


def test_seconds_that_nobody_states_are_called_a_guess_and_a_unit_of_time_settles_it(tmp_path: Path) -> None:
    text = table(np.cumsum(np.random.default_rng(0).choice([4, 5, 6], N)), X, Y, header=("t", "u", "y"))
    guessed, told = opened(tmp_path, text), opened(tmp_path, text, time_unit="ms")
    assert re.search(r"one every 5.* s \(seconds assumed; override with --time-unit\)", guessed.describe())
    assert (guessed.guessed_seconds, told.guessed_seconds) == (True, False)
    assert (told.sample_time, "guess," in told.describe()) == (pytest.approx(0.005, rel=0.01), False)


@pytest.mark.parametrize(
    ("factors", "options"),
    [((1, 1e6, 1), {"input_unit": "V"}), ((1, 1, 1e6), {"output_unit": "um"}), ((1e6, 1, 1), {"time_unit": "s"})],
)
def test_an_unusual_magnitude_is_read_if_its_unit_is_confirmed(
    tmp_path: Path, factors: tuple[float, ...], options: dict[str, str]
) -> None:
    columns = [factor * values for factor, values in zip(factors, (T, X, Y), strict=True)]
    assert opened(tmp_path, table(*columns, digits=12), **options).length == N


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_part_is_read_by_seconds_and_every_tenth_row(
    tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f"stage{suffix}"
    write_table(path, dict(zip(HEADER, (T, X, Y), strict=True)))
    part = Recording.open(path, from_s=1.0, to_s=2.0, decimate=10)
    np.testing.assert_array_equal([part.x, part.y], [X[200:401:10], Y[200:401:10]])
    assert part.sample_time == pytest.approx(10 * PERIOD)
    assert "one row in 10" in part.describe()
    monkeypatch.setattr("piezo_model.recordings.table.free_memory", lambda: 100_000.0)
    assert "read part of it with --from and --to (seconds), or every tenth row" in refusal(path)
    assert Recording.open(path, to_s=1.0).length == 201


def recorded(folder: Path, x: np.ndarray, y: np.ndarray) -> Recording:
    """A recording at 1 kHz, from a file."""
    write_table(folder / "stage.parquet", dict(zip(HEADER, (np.arange(x.size) / 1000.0, x, y), strict=True)))
    return Recording.open(folder / "stage.parquet")


@pytest.mark.parametrize("offset", [20.0, -120.0])
@pytest.mark.parametrize(
    "drive",
    [
        lambda t: 40.0 * np.arcsin(np.sin(8.0 * t)),
        lambda t: 20.0 * np.sin(20.0 * t) + 15.0 * np.sin(47.0 * t),
    ],
    ids=["triangle", "multi_sine"],
)
def test_an_output_that_drops_out_to_one_value_beyond_all_others_is_missing_there(
    tmp_path: Path, drive: Callable[[np.ndarray], np.ndarray], offset: float
) -> None:
    t, at = np.arange(4000) / 1000.0, np.random.default_rng(3).choice(np.arange(20, 3980), 37, replace=False)
    x = 50.0 + drive(t)
    y = offset + 0.8 * x + 0.1 * np.clip(x, 30.0, 70.0)
    dropped = np.where(np.isin(np.arange(t.size), at), 0.0, y)
    found = recorded(tmp_path, x, dropped)
    far = np.abs(dropped - y) > 0.05 * np.ptp(y)
    assert np.count_nonzero(far) > 25
    assert found.uncounted[far].all()
    assert not found.uncounted[dropped == y].any()
    assert np.max(np.abs(found.y - y)) < 0.05 * np.ptp(y)
    assert "beyond all others: a sensor dropout, not counted" in " ".join(found.remarks)


@pytest.mark.parametrize("drive", [np.sin, np.sign, lambda phase: np.round(3.0 * np.sin(phase))])
@pytest.mark.parametrize("per_period", [12, 40, 400])
def test_an_output_at_the_limit_of_its_sensor_or_between_levels_does_not_drop_out(
    tmp_path: Path, drive: Callable[[np.ndarray], np.ndarray], per_period: int
) -> None:
    x = 50.0 + 40.0 * drive(2.0 * np.pi * np.arange(4000) / per_period)
    y = np.round(0.8 * x + 0.02 * np.random.default_rng(4).normal(size=x.size), 2)
    for limited in (y, np.clip(y, *np.quantile(y, [0.1, 0.9])), np.minimum(y, np.quantile(y, 0.98))):
        found = recorded(tmp_path, x, limited)
        np.testing.assert_array_equal(found.y, limited)
        assert not found.uncounted.any()
