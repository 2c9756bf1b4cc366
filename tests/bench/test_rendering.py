"""Texts from a recording's header stay texts in every output."""

import ctypes
import io
import json
import re
import subprocess
import xml.etree.ElementTree as ET
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command_line import CommandLine
from exported_loops import a_model
from programs import program

from bench.rendering import c_templates
from bench.report.console import PlainConsole, print_table
from piezo_model.signals import multi_sine

RUN = "int system(const char *); __attribute__((constructor)) static void run_it(void) {{ if (system({touch})) {{ }} }}"
UNITS = (
    (
        'V\\n", k, lowest, highest); int system(const char *); system({touch}); fprintf(stderr, "',
        f"um */\n#ifndef RUN\n#define RUN\n{RUN}\n#endif\n/*",
    ),
    ('"/><x y="<&>" %s %n \\" ??/ \N{DEGREE SIGN}\x01', "*/ %s ??/"),
)
"""Units that end a comment, a string and an attribute, and name signs that formats, C and XML do not take as they
are."""


@pytest.mark.sample(1)
@pytest.mark.needs("cc")
@pytest.mark.parametrize(("unit", "output_unit"), UNITS)
def test_a_unit_that_is_code_is_written_and_never_executed(
    piezobench: CommandLine, tmp_path: Path, unit: str, output_unit: str
) -> None:
    touched = tmp_path / "touched"
    unit, output_unit = (text.format(touch=f'"touch {touched}"') for text in (unit, output_unit))
    x = multi_sine(duration_s=2.0, sample_time=1e-3, low=0.0, high=150.0, seed=1)
    pd.DataFrame(
        {
            "time_s": np.arange(x.size) * 1e-3,
            f"voltage [{unit}]": x,
            f"displacement [{output_unit}]": a_model().simulate(x),
        },
    ).to_parquet(tmp_path / "stage.parquet")

    piezobench.run("identify", "stage.parquet", "--out", "m.json", folder=tmp_path)
    # readers of recordings drop invalid units, but a model file may contain any text
    file = json.loads((tmp_path / "m.json").read_text())
    file["structure"] |= {"input_unit": unit, "output_unit": output_unit}
    (tmp_path / "m.json").write_text(json.dumps(file))
    for folder in ("compensator", "learning"):
        piezobench.run("export-c", "m.json", folder, "--part", folder, folder=tmp_path)
        said = subprocess.run([program("make"), "-C", tmp_path / folder, "run"], capture_output=True, check=True).stderr
        assert unit.encode() in said
    for name in ("2", "3"):
        piezobench.run("export-fmu", "m.json", f"{name}.fmu", "--fmi", name, folder=tmp_path)
        zipfile.ZipFile(tmp_path / f"{name}.fmu").extractall(tmp_path / name)
        description = ET.parse(tmp_path / name / "modelDescription.xml")
        assert unit.replace("\x01", "\ufffd") in [found.get("name") for found in description.iter("Unit")]
        ctypes.CDLL(*map(str, (tmp_path / name / "binaries").rglob("*.so")))
    piezobench.run("realtime", "m.json", "--seconds", "0.02", "--priority", "0", folder=tmp_path)
    assert not touched.exists()


HOSTILE = "[red]x[/blue] [/] :smile: \x1b[2J\x1b]0;owned\x07 \x9b31m <b>|</b> `c` *d* µ \u202e\u2028end"
"""Markup of Rich, escape sequences of seven and of eight bits, HTML, Markdown, and signs that turn lines round."""


def test_hostile_text_reaches_a_terminal_as_text(monkeypatch: pytest.MonkeyPatch) -> None:
    shown = io.StringIO()
    console = PlainConsole(file=shown, force_terminal=True, width=400)
    monkeypatch.setattr("bench.report.console.console", console)
    console.print(HOSTILE)
    console.print(HOSTILE, style="bold")
    print_table((HOSTILE, "b"), [(HOSTILE, HOSTILE)])
    text = re.sub(r"\x1b\[[0-9;]*m", "", shown.getvalue())  # Rich's own sequences for bold text
    assert text.count(r"[red]x[/blue] [/] :smile: \x1b[2J\x1b]0;owned\x07 \x9b31m") == 5
    assert all(sign.isprintable() or sign == "\n" for sign in text)


def test_a_terminal_that_says_that_it_is_0_columns_wide_is_of_unknown_width(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "0")
    assert PlainConsole(force_terminal=True).width == 100


@pytest.mark.sample(1)
@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "utf-8"])
def test_a_terminal_that_lacks_characters_is_no_reason_to_fail(
    piezobench: CommandLine, tmp_path: Path, encoding: str
) -> None:
    x = multi_sine(duration_s=2.0, sample_time=1e-3, low=0.0, high=150.0, seed=1)
    recording, model = tmp_path / "stage\x1b[2J[red].csv", tmp_path / "m.json"
    y = a_model().simulate(x)
    pd.DataFrame({"time_s": np.arange(x.size) * 1e-3, "[red]drive \x1b[2J[/blue] [V]": x, "h [/] [µm]": y}).to_csv(
        recording, index=False
    )
    done = piezobench.run("identify", recording, "--out", model, encoding=encoding)
    assert not {0x1B, 0x9B} & set((done.stdout + done.stderr).encode(encoding))
    assert ("[red]drive " in done.stdout, model.is_file()) == (True, True)


def test_text_that_reaches_c_without_a_filter_is_refused() -> None:
    with pytest.raises(ValueError, match="without a filter"):
        c_templates("bench.export").from_string("/* {{ unit }} */").render(unit="*/")
