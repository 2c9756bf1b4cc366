"""What stands in a recording's header stays text in everything that is made from it."""

from __future__ import annotations

import ctypes
import json
import subprocess
import xml.etree.ElementTree as ET
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command_line import CommandLine
from test_export_c import a_model

from bench.export.building import tool
from bench.export.c_source import render
from bench.rendering import c_templates
from piezo_model.signals import multi_sine

RUN = "int system(const char *); __attribute__((constructor)) static void run_it(void) {{ if (system({touch})) {{ }} }}"
UNITS = (("V", f"um */\n#ifndef RUN\n#define RUN\n{RUN}\n#endif\n/*"),
         ('V\\n", k, lowest, highest); int system(const char *); system({touch}); fprintf(stderr, "', "um"),
         ('"/><x y="<&>" %s %n \\" ??/ \N{DEGREE SIGN}\x01', "*/ %s ??/"))
"""Units that end a comment, a string and an attribute, and name signs that formats, C and XML do not take as they are."""


@pytest.mark.parametrize(("unit", "output_unit"), UNITS)
def test_a_unit_that_is_a_program_is_written_and_never_run(piezobench: CommandLine, tmp_path: Path, unit: str,
                                                               output_unit: str) -> None:
    touched = tmp_path / "touched"
    unit, output_unit = (text.format(touch=f'"touch {touched}"') for text in (unit, output_unit))
    x = multi_sine(duration_s=2.0, sample_time=1e-3, low=0.0, high=150.0, seed=1)
    pd.DataFrame({"time_s": np.arange(x.size) * 1e-3, f"voltage [{unit}]": x, f"displacement [{output_unit}]": a_model().simulate(x)},
                 ).to_parquet(tmp_path / "stage.parquet")

    def call(*words: object) -> str:
        done = piezobench(*words, folder=tmp_path)
        assert done.status == 0, done.stderr
        return done.stdout

    call("identify", "stage.parquet", "--out", "m.json")
    file = json.loads((tmp_path / "m.json").read_text())  # a reader of recordings drops what is no unit, a model file may hold anything
    file["structure"] |= {"input_unit": unit, "output_unit": output_unit}
    (tmp_path / "m.json").write_text(json.dumps(file))
    call("export-c", "m.json", "c")
    call("export-c", "m.json", "learning", "--part", "learning")
    for folder in ("c", "learning"):
        said = subprocess.run([tool("make"), "-C", tmp_path / folder, "run"], capture_output=True, check=True).stderr
        assert unit.encode() in said
    call("export-fmu", "m.json", "two.fmu", "--fmi", "2")
    call("export-fmu", "m.json", "three.fmu")
    for name in ("two", "three"):
        zipfile.ZipFile(tmp_path / f"{name}.fmu").extractall(tmp_path / name)
        description = ET.parse(tmp_path / name / "modelDescription.xml")
        assert unit.replace("\x01", "\ufffd") in [found.get("name") for found in description.iter("Unit")]
        (library,) = (tmp_path / name / "binaries").rglob("*.so")
        ctypes.CDLL(str(library))
    call("realtime", "m.json", "--seconds", "0.02", "--priority", "0", "--no-cost")
    assert not touched.exists()


def test_a_title_cannot_break_out_of_its_comment() -> None:
    text = render(a_model(), title="*/ int main; /* \\ µ ??/")["piezo_parameters.h"]
    assert text.startswith("/* _/ int main; /_ _ _ _?/\n")


def test_text_that_reaches_c_without_a_filter_is_refused() -> None:
    with pytest.raises(ValueError, match="without a filter"):
        c_templates("bench.export").from_string("/* {{ unit }} */").render(unit="*/")
