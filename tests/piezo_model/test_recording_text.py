"""One table written in every form of plain text; each file must give the same arrays to the last bit."""

import csv
import io
import pickle
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from recording_files import N, X, Y, text_file, with_times

from piezo_model.recordings import Recording, RecordingError
from piezo_model.recordings.layout import layout_of

RATE = 997.0
T = np.arange(N) / RATE


def rows(line: str, end: str = "\n", decimal: str = ".", times: list[str] | None = None) -> str:
    """One line per sample; {t}, {x} and {y} are printed with the decimal mark, {i} is the index."""
    times = times or [f"{t:.7f}" for t in T]
    return (
        end.join(
            line.format(
                i=i,
                t=times[i].replace(".", decimal),
                x=f"{X[i]:.6f}".replace(".", decimal),
                y=f"{Y[i]:.6f}".replace(".", decimal),
                flag=i > 1200,
            )
            for i in range(N)
        )
        + end
    )


def clock(day: str, start: float = 0.0) -> list[str]:
    return [day.format(f"{int(s // 3600) % 24:02d}:{int(s // 60) % 60:02d}:{s % 60:09.6f}") for s in T + start]


HEADER = "time_s,voltage_V,height_um\n"
FILES: dict[str, tuple[bytes | str, dict]] = {
    "no header": (rows("{t},{x},{y}"), {"input": "2", "output": "3"}),
    "metadata": (f"Instrument: stage\nDate,2024-01-31\nGain,10,V/V\n\n{HEADER}{rows('{t},{x},{y}')}", {}),
    "comments with the header": (
        f"# stage\n# 3 channels\n#\n# time\tvoltage\theight\n{rows(f'{{t}}{chr(9)}{{x}}{chr(9)}{{y}}')}",
        {},
    ),
    "per cent comments": (f"% time voltage height\n% s V um\n{rows('{t} {x} {y}')}", {}),
    "slash comments": (f"// recorded\n// {HEADER}{rows('{t},{x},{y}')}", {}),
    "units row": (f"time;voltage;height\ns;V;µm\n{rows('{t};{x};{y}')}", {}),
    "bracketed units row": (f"time\tvoltage\theight\n[s]\t[V]\t[µm]\n{rows(f'{{t}}{chr(9)}{{x}}{chr(9)}{{y}}')}", {}),
    "units in brackets": (f"Time [s],Drive (V),Sensor [µm]\n{rows('{t},{x},{y}')}", {}),
    "empty first column": (f",time_s,voltage_V,height_um\n{rows(',{t},{x},{y}')}", {}),
    "index column": (f",time_s,voltage_V,height_um\n{rows('{i},{t},{x},{y}')}", {}),
    "index column of R": (f'"time_s" "voltage_V" "height_um"\n{rows("{i} {t} {x} {y}")}', {}),
    "a last column without a name": (f"time_s,voltage_V,height_um\n{rows('{t},{x},{y},{t}')}", {}),
    "names with a slash below a remark": (f"# made by a rig\nt/s|u/V|y/um\n{rows('{t}|{x}|{y}')}", {}),
    "Boolean column": (f"height_um,voltage_V,contact,time_s\n{rows('{y},{x},{flag},{t}')}", {}),
    "quotes": ('time_s,voltage_V,"height_um",note\n' + rows('{t}, {x} ,"{y}","so, so"'), {}),
    "signs and exponents": (HEADER + rows("{t},+{x},{y}e0"), {}),
    "text column": (f"segment,time_s,voltage_V,height_um\n{rows('approach,{t},{x},{y}')}", {}),
    "separator at the end": (f"time_s;voltage_V;height_um;\n{rows('{t};{x};{y};')}", {}),
    "separator at the end of rows": (f"time_s;voltage_V;height_um\n{rows('{t};{x};{y};')}", {}),
    "comment that no row has": (
        f"X_Value\tvoltage_V\theight_um\tComment\n{rows(f'{{t}}{chr(9)}{{x}}{chr(9)}{{y}}')}",
        {},
    ),
    "carriage returns": (f"time_s,voltage_V,height_um\r\n{rows('{t},{x},{y}', end=chr(13) + chr(10))}", {}),
    "carriage returns alone": (f"time_s,voltage_V,height_um\r{rows('{t},{x},{y}', end=chr(13))}", {}),
    "byte order mark": (b"\xef\xbb\xbf" + (HEADER + rows("{t},{x},{y}")).encode(), {}),
    "UTF-16": ((HEADER + rows("{t},{x},{y}")).replace(",", "\t").encode("utf-16"), {}),
    "Latin-1": (f"Zeit [s];Spannung [V];Höhe [µm]\n{rows('{t};{x};{y}')}".encode("latin-1"), {}),
    "decimal comma": (f"time_s;voltage_V;height_um\n{rows('{t};{x};{y}', decimal=',')}", {}),
    "decimal comma and tabs": (HEADER.replace(",", "\t") + rows("{t}\t{x}\t{y}", decimal=","), {}),
    "decimal comma and blanks": (f"time voltage height\n{rows('{t}   {x} {y}', decimal=',')}", {}),
    "decimal commas between commas": (
        f"Time, Drive, Unit, Value, Unit\n{rows('{t}, {x}, V, {y}, um', decimal=',')}",
        {},
    ),
    "decimal commas between commas, and an empty cell": (
        f"Time, Drive, Sensor, Note\n{rows('{t}, {x}, {y}, ', decimal=',')}",
        {},
    ),
    "oscilloscope's increment": (
        f"X,Drive,CH2,Start,Increment,\nSequence,Volt,Volt,-6e-2,{1 / RATE:.9e},\n{rows('{i},{x},{y},,,')}",
        {"output": "CH2"},
    ),
    "oscilloscope's narrow rows": (
        f"X,Drive,CH2,Start,Increment\nSequence,Volt,Volt,-6e-2,{1 / RATE:.9e}\n{rows('{i},{x},{y},')}",
        {"output": "CH2"},
    ),
    "increment in the header": (
        f"X,Drive,Sensor,t0 = -0.4s, tInc = {1 / RATE:.9f}s\n{rows('{i},{x},{y},,')}",
        {},
    ),
    "decimal comma in quotes": (
        '"time_s","voltage_V","height_um"\n' + rows('"{t}","{x}","{y}"', decimal=","),
        {},
    ),
    "blanks": (f"Time (s)  Piezo voltage (V)  Height (um)\n{rows('  {t}   {x}  {y}  ')}", {}),
    "repeated header": (HEADER + rows("{t},{x},{y}").replace("\n", "\n" + HEADER, 1), {}),
    "comments among rows": (HEADER + rows("{t},{x},{y}").replace("\n", "\n# pause\n", 1), {}),
    "blank lines among rows": (HEADER + rows("{t},{x},{y}", end="\n\n"), {}),
    "no line break at the end": (HEADER + rows("{t},{x},{y}").rstrip(), {}),
    "blank lines at the end": (HEADER + rows("{t},{x},{y}") + "\n\n ,,\n", {}),
    "row cut off at the end": (HEADER + rows("{t},{x},{y}") + "2.6,3", {}),
    "remark at the end": (HEADER + rows("{t},{x},{y}") + "\nEnd of measurement\n", {}),
    "columns of unequal length": (HEADER + rows("{t},{x},{y}") + "2.6,3,\n2.7,4,\n", {}),
    "rule under the header": (f"time_s voltage_V height_um\n------ --------- ---------\n{rows('{t} {x} {y}')}", {}),
    "clock": (f"Timestamp,voltage_V,height_um\n{rows('{t},{x},{y}', times=clock('{}', 43000.0))}", {}),
    "clock past midnight": (f"Timestamp,voltage_V,height_um\n{rows('{t},{x},{y}', times=clock('{}', 86399.0))}", {}),
    "minutes and seconds past the hour": (
        f"Timestamp,voltage_V,height_um\n{rows('{t},{x},{y}', times=[c[3:] for c in clock('{}', 3599.0)])}",
        {},
    ),
    "ISO date": (f"when,voltage_V,height_um\n{rows('{t},{x},{y}', times=clock('2024-01-31T{}Z'))}", {}),
    "dotted date": (f"when;voltage_V;height_um\n{rows('{t};{x};{y}', times=clock('2024.01.31 {}'))}", {}),
    "German date": (
        f"Zeit;voltage_V;height_um\n{rows('{t};{x};{y}', decimal=',', times=clock('31.01.2024 {}'))}".replace(
            "31,01,2024", "31.01.2024"
        ),
        {},
    ),
    "dotted clock": (
        f"Zeit;voltage_V;height_um\n{rows('{t};{x};{y}', times=[c.replace(':', '.') for c in clock('{}')])}",
        {},
    ),
    "single precision": (HEADER + rows("{t},{x},{y}", times=[repr(float(np.float32(t))) for t in T + 40]), {}),
    "seven digits": (HEADER + rows("{t},{x},{y}", times=[f"{t:.7g}" for t in T + 8.5]), {}),
    "no time": (f"voltage_V,height_um\n{rows('{x},{y}')}", {"sample_time": 1 / RATE}),
    "no time but a rate": (f"# Sampling rate [kHz]: 0.997\nvoltage_V,height_um\n{rows('{x},{y}')}", {}),
    "a rate in a cell of its own": (f"Sampling rate [kHz]:,0.997,\nvoltage_V,height_um\n{rows('{x},{y}')}", {}),
    "numbers as names, by their row": (
        f"time,1,2\n{rows('{t},{x},{y}')}",
        {"header_row": 1, "input": "1", "output": "2"},
    ),
    "clock that is not believed": (
        f"time_s,voltage_V,height_um\n{rows('0,{x},{y}')}",
        {"sample_time": 1 / RATE, "time": "none"},
    ),
    "preamble of names and numbers": (f"Kp,Ki,Kd\n1.5,20,0.003\n{HEADER}{rows('{t},{x},{y}')}", {}),
    "numbers above the header": (f"1,2,3\nGain,10,3\n\n{HEADER}{rows('{t},{x},{y}')}", {}),
    "table of another kind below": (
        f"{HEADER}{rows('{t},{x},{y}')}\nfreq_Hz,gain,phase\n{rows('{i},{x},{y}')}",
        {},
    ),
    "table of another kind above": (
        f"freq_Hz;gain\n{rows('{i};{x}')}{HEADER}{rows('{t},{x},{y}')}".replace(",", ";"),
        {},
    ),
    "one of two tables": (
        f"[step]\n{HEADER}{rows('{i},{x},{y}')}\n[sine]\n{HEADER}{rows('{t},{x},{y}')}",
        {"table": "sine"},
    ),
    "channels of two tables": (
        f"time_s,CH1,CH2\n{rows('{i},{x},{y}')}time_s,CH3,CH4\n{rows('{t},{x},{y}')}",
        {"input": "CH3", "output": "CH4"},
    ),
    "header by its row": (f"1,2,3\nnumbers,follow,below\n{HEADER}{rows('{t},{x},{y}')}", {"header_row": 3}),
    "header without its line break": (
        "# afmformats\n#\n# height (measured)\theight (piezo)\tsegment\ttime"
        + rows("{y}\t{x}\t{flag}\t{t}", end="\r\n"),
        {},
    ),
    "LabVIEW's rows without times": (
        f"LabVIEW Measurement\t\nX_Columns\tNo\n***End_of_Header***\t\n\t\nChannels\t2\t\t\nSamples\t{N}\t{N}\t\n"
        f"Delta_X\t{1 / RATE:.9f}\t{1 / RATE:.9f}\t\n***End_of_Header***\t\t\t\n"
        f"X_Value\tDrive voltage\tSensor height\tComment\n{rows(chr(9) + '{x}' + chr(9) + '{y}')}",
        {},
    ),
    "columns by number": (f"a,b,c\n{rows('{y},{t},{x}')}", {"time": 2, "input": "3", "output": 1}),
    "header far above its rows": (f"{HEADER}# one\n# two\n\n# three\n# four\n{rows('{t},{x},{y}')}", {"header_row": 1}),
}


@pytest.mark.parametrize("name", FILES)
def test_plain_text_of_every_kind_gives_the_clean_arrays(tmp_path: Path, name: str) -> None:
    content, options = FILES[name]
    path = tmp_path / "stage.log"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    recording = Recording.open(path, **options)
    np.testing.assert_array_equal([recording.x, recording.y], [X, Y])
    assert recording.sample_time == pytest.approx(1 / RATE, rel=3e-5)
    assert pickle.loads(pickle.dumps(recording)).digest() == recording.digest()


def test_a_recording_describes_its_dialect_and_guesses_in_two_lines(tmp_path: Path) -> None:
    path = tmp_path / "stage.csv"
    path.write_text(f"Zeit;Spannung;Höhe\ns;V;µm\n{rows('{t};{x};{y}', decimal=',')}", encoding="latin-1")
    first, second = Recording.open(path).describe().splitlines()
    assert (
        "text in Latin-1, separated by semicolons, decimal comma, header in row 1; 1300 samples over 1.303 s" in first
    )
    assert second == (
        "input 'Spannung' from 0.000143 to 100 V, output 'Höhe' from -45.01 to -34.99 µm; guessed: time, "
        "input, output by "
        "name (override with --time, --input, --output)"
    )


def stamps(form: str, start: str, period_ns: int, count: int) -> list[str]:
    """Times as text: {Y}, {M}, {D}, {h}, {m}, {s} and {n}, the nanoseconds."""
    times = np.datetime64(start, "ns") + period_ns * np.arange(count).astype("m8[ns]")
    parts = np.char.split(np.char.translate(times.astype(str), str.maketrans("-T:.", "    ")))
    return [form.format(**dict(zip("YMDhmsn", part, strict=True))) for part in parts.tolist()]


def midnight(order: str, day: str, rows_before: int) -> list[str]:
    """A day's last milliseconds and the next day's first second."""
    start = np.datetime64(f"2024-{day}T23:59:59.999999", "ns") - np.timedelta64(rows_before, "ms")
    return stamps(f"{order} {{h}}:{{m}}:{{s}}.{{n}}", str(start), 1_000_000, rows_before + 1000)


MINUTES = [f"{k // 600 % 60:02d}:{k // 10 % 60:02d}" + (f".{k % 10}" if k % 10 else "") for k in range(20_001, 22_001)]
"""Of minutes and seconds, without a fraction on whole seconds."""


@pytest.mark.parametrize(
    ("times", "period"),
    [
        *(
            pytest.param(stamps(form, "2024-01-31T12:00:59.9999", ns, 1500), ns / 1e9, id=f"{form} {ns} ns")
            for form in (
                "{Y}-{M}-{D}T{h}:{m}:{s}.{n}Z",
                "{D}.{M}.{Y} {h}:{m}:{s}.{n}",
                "{h}:{m}:{s}.{n}",
                "{m}:{s}.{n}",
            )
            for ns in (100, 500, 1000, 125_500)
        ),
        *(
            pytest.param(midnight(order, day, rows_before), 1e-3, id=f"{order} {day} {rows_before}")
            for order, day, rows_before in (
                *product(
                    ["{D}/{M}/{Y}", "{M}/{D}/{Y}", "{D}-{M}-{Y}", "{M}-{D}-{Y}", "{D}.{M}.{Y}"],
                    ["01-12", "01-11", "01-31", "12-31", "05-05"],
                    [5],
                ),
                *product(["{D}/{M}/{Y}", "{M}/{D}/{Y}"], ["01-12", "05-05"], [20_000]),
            )
        ),
        pytest.param(MINUTES, 0.1, id="minutes"),
    ],
)
def test_clocks_and_dates_in_any_order_are_read_to_the_nanosecond(
    tmp_path: Path, times: list[str], period: float
) -> None:
    found = Recording.open(with_times(tmp_path, times))
    assert (found.sample_time, found.remarks) == (period, ())


@settings(max_examples=60, deadline=None)
@given(
    separator=st.sampled_from(";\t ,|"),
    decimal=st.sampled_from(".,"),
    width=st.integers(2, 6),
    digits=st.integers(1, 9),
    header=st.booleans(),
    units=st.booleans(),
    quote=st.booleans(),
    seed=st.integers(0, 999),
)
def test_any_dialect_is_detected(
    separator: str, decimal: str, width: int, digits: int, header: bool, units: bool, quote: bool, seed: int
) -> None:
    assume(not (separator == "," == decimal and not quote) and not (separator == " " and quote))
    text, names = io.StringIO(), [f"signal{k}" for k in range(width)]
    writer = csv.writer(text, delimiter=separator, quoting=csv.QUOTE_ALL if quote else csv.QUOTE_MINIMAL)
    writer.writerows([names] * header + [["V"] * width] * (header and units))
    writer.writerows(
        [f"{value:.{digits}f}".replace(".", decimal) for value in row]
        for row in np.random.default_rng(seed).normal(0, 10, (30, width))
    )
    found = layout_of(text.getvalue().splitlines(keepends=True))
    assert (found.dialect.separator, found.dialect.decimal, len(found.columns)) == (separator, decimal, width)
    assert found.start == header + (header and units)
    assert [column.name for column in found.columns] == (names if header else [f"column {k + 1}" for k in range(width)])
    assert {column.unit for column in found.columns} == ({"V"} if header and units else {""})


@pytest.mark.parametrize("stated", ["10,000 Hz", "10 000 Hz", "10'000 Hz", "10 kHz", "1e4", "10000.0 Hz"])
def test_a_stated_rate_may_have_its_thousands_apart_and_is_named(tmp_path: Path, stated: str) -> None:
    found = Recording.open(text_file(tmp_path, f"# Sampling rate: {stated}\nvoltage_V,height_um\n{rows('{x},{y}')}"))
    assert found.sample_time == 1e-4
    assert "which states the sampling period; " in found.describe()


@pytest.mark.parametrize(
    ("stated", "period", "sentence"),
    [
        *(
            (stated, 0.002, "cannot tell which column is the time")
            for stated in (
                "# Sampling rate: 10,5 Hz",
                "# dt: 2026-11-28",
                "# dt: 28.11.2026",
                "# dt: 5,000 ms",
                "# dt: 1 ms\n# fs: 100 Hz",
            )
        ),
        ("# dt: 2026", 2026.0, "its header has one sample every 2026 s; is a decimal mark missing"),
    ],
)
def test_a_statement_that_is_no_period_or_one_of_minutes_is_not_taken_and_is_no_matter_beside_times(
    tmp_path: Path, stated: str, period: float, sentence: str
) -> None:
    path = text_file(tmp_path, f"{stated}\nvoltage_V,height_um\n{rows('{x},{y}')}")
    with pytest.raises(RecordingError, match=sentence):
        Recording.open(path)
    assert Recording.open(path, sample_time=period).sample_time == period
    path = text_file(tmp_path, f"{stated}\ntime_s,voltage_V,height_um\n{rows('{t},{x},{y}')}")
    assert Recording.open(path).length > 100
