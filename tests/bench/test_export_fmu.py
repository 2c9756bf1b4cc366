"""The compensator as an FMU, imported by FMPy."""

import subprocess
import xml.etree.ElementTree as ET
import zipfile
from pathlib import Path

import numpy as np
import pytest
from command_line import CommandLine
from exported_loops import LIMITS, SAMPLE_TIME, a_model
from programs import library, program

from bench.export.fmu import VARIABILITY, variables, write_fmu
from bench.export.settings import ExportSettings
from piezo_model import Compensator
from piezo_model.compensator import CORRECTION

fmpy = library("fmpy")
from fmpy.fmi2 import FMU2Slave  # noqa: E402
from fmpy.fmi3 import FMU3Slave  # noqa: E402
from fmpy.validation import validate_fmu  # noqa: E402

RATE_LIMIT = 5e4
VERSIONS = (2, 3)


@pytest.fixture(scope="module")
def fmus(piezobench: CommandLine, tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    """FMUs of both versions, written by the command line."""
    program("cc")
    folder = tmp_path_factory.mktemp("fmus")
    a_model().save(folder / "model.json")
    for fmi in VERSIONS:
        words = ("--fmi", fmi, "--low", LIMITS[0], "--high", LIMITS[1], "--rate-limit", RATE_LIMIT)
        piezobench.quietly("export-fmu", "model.json", f"{fmi}.fmu", *words, folder=folder)
    return {fmi: folder / f"{fmi}.fmu" for fmi in VERSIONS}


def reference() -> np.ndarray:
    """A reference that exceeds the range, so that the limits are reached."""
    t = np.arange(4000) * SAMPLE_TIME
    return 17.0 * np.sin(2 * np.pi * 9.0 * t) + 6.0 * np.sin(2 * np.pi * 71.0 * t)


def simulated(path: Path, y_ref: np.ndarray, **start: float) -> np.ndarray:
    """Drives from FMPy's simulation: that for the reference at t appears at t + T."""
    found = fmpy.simulate_fmu(
        str(path),
        stop_time=y_ref.size * SAMPLE_TIME,
        step_size=SAMPLE_TIME,
        output_interval=SAMPLE_TIME,
        input=np.rec.fromarrays([np.arange(y_ref.size) * SAMPLE_TIME, y_ref], names="time,reference"),
        output=["drive"],
        start_values=start,
        fmi_type="CoSimulation",
    )
    # it begins where the stage is
    assert (found["drive"].size, found["drive"][0]) == (y_ref.size + 1, LIMITS[0])
    return found["drive"][1:]


def slave(path: Path, fmi: int, folder: Path) -> FMU2Slave | FMU3Slave:
    """An initialised instance."""
    description = fmpy.read_model_description(str(path))
    kind, token = (FMU2Slave, description.guid) if fmi == 2 else (FMU3Slave, description.instantiationToken)
    fmpy.extract(str(path), unzipdir=str(folder))
    it = kind(
        guid=token,
        unzipDirectory=str(folder),
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="it",
    )
    it.instantiate()
    if fmi == 2:
        it.setupExperiment(startTime=0.0)
    it.enterInitializationMode()
    it.exitInitializationMode()
    return it


def step(it: FMU2Slave | FMU3Slave, fmi: int, k: int, y_ref: float, interval: float = SAMPLE_TIME) -> float:
    """One communication step."""
    (it.setReal if fmi == 2 else it.setFloat64)([1], [y_ref])
    it.doStep(currentCommunicationPoint=k * SAMPLE_TIME, communicationStepSize=interval)
    return float((it.getReal if fmi == 2 else it.getFloat64)([2])[0])


@pytest.mark.parametrize("fmi", VERSIONS)
def test_fmpys_validation_finds_no_fault(fmus: dict[int, Path], fmi: int) -> None:
    assert validate_fmu(str(fmus[fmi])) == []


@pytest.mark.sample(1)
@pytest.mark.parametrize("fmi", VERSIONS)
def test_the_trajectory_in_fmpy_is_that_of_python(fmus: dict[int, Path], fmi: int) -> None:
    y_ref, limits, usual = reference(), (0.5 * LIMITS[1], LIMITS[1] - 1.0), Compensator(a_model(), LIMITS, RATE_LIMIT)
    other = Compensator(a_model(), limits, state=usual.state)  # the stage is where the export says
    for start, compensator in (
        ({}, usual),
        ({"lowest_drive": limits[0], "highest_drive": limits[1], "rate_limit": 0.0}, other),
    ):
        x = compensator.run(y_ref)
        np.testing.assert_array_equal(simulated(fmus[fmi], y_ref, **start), x)
        assert (x.min(), x.max()) == (limits if start else LIMITS)
        assert start or abs(x[0] - LIMITS[0]) <= RATE_LIMIT * SAMPLE_TIME + 1e-12


@pytest.mark.sample(1)
@pytest.mark.needs("cc")
@pytest.mark.parametrize("fmi", VERSIONS)
def test_integral_action_on_what_is_measured_is_that_of_python(tmp_path: Path, fmi: int) -> None:
    gain, y_ref = 0.4 / SAMPLE_TIME, reference()[:400]
    measured = 0.9 * np.roll(y_ref, 1) + 0.3
    write_fmu(a_model(), ExportSettings(x_limits=LIMITS, integral_gain=gain), tmp_path / "loop.fmu", fmi)
    it, compensator = (
        slave(tmp_path / "loop.fmu", fmi, tmp_path / "loop"),
        Compensator(a_model(), LIMITS, integral_gain=gain),
    )
    for k, (wanted, y) in enumerate(zip(y_ref, measured, strict=True)):
        (it.setReal if fmi == 2 else it.setFloat64)([6], [y])
        compensator.correct(y)
        assert step(it, fmi, k, wanted) == compensator.step(wanted)
    assert compensator.drive[CORRECTION] != 0.0
    it.terminate()
    it.freeInstance()


@pytest.mark.parametrize("fmi", VERSIONS)
def test_variables_have_units_start_values_and_the_step_is_fixed(fmus: dict[int, Path], fmi: int) -> None:
    description = fmpy.read_model_description(str(fmus[fmi]))
    co_simulation, steps = description.coSimulation, [description.defaultExperiment.stepSize]
    assert (description.fmiVersion, co_simulation.canHandleVariableCommunicationStepSize) == (f"{fmi}.0", False)
    steps += [co_simulation.fixedInternalStepSize] if fmi == 3 else []
    assert {*map(float, steps)} == {SAMPLE_TIME}
    found = {v.name: v for v in description.modelVariables if v.name != "time"}
    for expected in variables(a_model(), ExportSettings(x_limits=LIMITS, rate_limit=RATE_LIMIT)):
        v = found.pop(expected.name)
        assert (v.causality, v.variability, float(v.start), v.unit) == (
            expected.causality,
            VARIABILITY.get(expected.causality, "discrete"),
            expected.start,
            expected.unit,
        )
        assert v.description
    assert found == {}
    assert {"V", "V/s", "um"} <= {unit.name for unit in description.unitDefinitions}


@pytest.mark.parametrize("fmi", VERSIONS)
def test_a_communication_step_is_a_whole_number_of_samples_or_refused(
    fmus: dict[int, Path], fmi: int, tmp_path: Path
) -> None:
    it = slave(fmus[fmi], fmi, tmp_path)
    assert step(it, fmi, 0, 5.0, 3 * SAMPLE_TIME) == pytest.approx(
        Compensator(a_model(), LIMITS, RATE_LIMIT).run([5.0] * 3)[-1], rel=1e-14
    )
    with pytest.raises(Exception, match="oStep"):
        step(it, fmi, 3, 5.0, 1.5 * SAMPLE_TIME)
    it.freeInstance()


@pytest.mark.parametrize("fmi", VERSIONS)
def test_a_saved_state_gives_the_same_drives_again(fmus: dict[int, Path], fmi: int, tmp_path: Path) -> None:
    it, y_ref = slave(fmus[fmi], fmi, tmp_path), reference()[:300]
    for k in range(100):
        step(it, fmi, k, y_ref[k])
    note, write, restored = (
        (it.getFMUstate, it.serializeFMUstate, it.deSerializeFMUstate)
        if fmi == 2
        else (it.getFMUState, it.serializeFMUState, it.deserializeFMUState)
    )
    state = note()
    stored = write(state)
    first = [step(it, fmi, k, y_ref[k]) for k in range(100, 300)]
    for again in (state, restored(stored)):
        it.setFMUState(again) if fmi == 3 else it.setFMUstate(again)
        assert [step(it, fmi, k, y_ref[k]) for k in range(100, 300)] == first
        it.freeFMUState(again) if fmi == 3 else it.freeFMUstate(again)
    it.freeInstance()


@pytest.mark.sample(1)
@pytest.mark.parametrize("fmi", VERSIONS)
def test_its_sources_build_the_same_library_again(fmus: dict[int, Path], fmi: int, tmp_path: Path) -> None:
    with zipfile.ZipFile(fmus[fmi]) as archive:
        archive.extractall(tmp_path)
    description = ET.parse(tmp_path / ("modelDescription.xml" if fmi == 2 else "sources/buildDescription.xml"))
    names = [str(each.get("name")) for each in description.iter("File" if fmi == 2 else "SourceFile")]
    assert len(names) == 2
    subprocess.run(
        [program("gcc"), "-std=c99", "-ffp-contract=off", "-O2", "-fPIC", "-shared", *names, "-o", "again.so", "-lm"],
        cwd=tmp_path / "sources",
        check=True,
    )
    for binary in (tmp_path / "binaries").rglob("*.so"):
        binary.write_bytes((tmp_path / "sources" / "again.so").read_bytes())
    y_ref = reference()[:500]
    np.testing.assert_array_equal(simulated(tmp_path, y_ref), Compensator(a_model(), LIMITS, RATE_LIMIT).run(y_ref))


def test_invalid_limits_are_refused_at_initialisation(fmus: dict[int, Path]) -> None:
    for path in fmus.values():
        with pytest.raises(Exception, match="xitInitializationMode"):
            simulated(path, reference()[:10], lowest_drive=200.0)


def test_the_same_model_gives_the_same_token_and_another_one_another(fmus: dict[int, Path], tmp_path: Path) -> None:
    def token(path: Path) -> str:
        return str(fmpy.read_model_description(str(path)).instantiationToken)

    settings = ExportSettings(x_limits=LIMITS, rate_limit=RATE_LIMIT)
    write_fmu(a_model(), settings, tmp_path / "same.fmu")
    write_fmu(a_model(seed=1), settings, tmp_path / "other.fmu")
    assert token(fmus[3]) == token(tmp_path / "same.fmu") != token(tmp_path / "other.fmu")
