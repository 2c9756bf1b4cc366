"""The exported C on ARM Cortex-M: sizes of the image, the same numbers, instructions of a step, under an emulator.

The image holds the step and what it needs of the compiler's arithmetic, no start-up code and no drivers. It runs under
qemu's user mode, which executes the same Thumb-2 instructions one by one and lists them. There are no cycles: a
controller's memory and pipeline are not modelled.
"""

import signal
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bench.export.building import EXACT, WARNINGS, compiled, tool, units, write_files
from bench.export.c_source import export, render
from bench.export.settings import ExportError, ExportSettings
from piezo_model import HysteresisCreepModel
from solvers.arrays import Vector

COMPILER, EMULATOR = "arm-none-eabi-gcc", "qemu-arm"
PACKAGES = {COMPILER: "gcc-arm-none-eabi libnewlib-arm-none-eabi", EMULATOR: "qemu-user"}
FLAGS = (
    "-std=c99",
    "-O2",
    "-mthumb",
    "-mfloat-abi=hard",
    "-ffunction-sections",
    "-fdata-sections",
    "-nostartfiles",
    "--specs=nosys.specs",
    "-Wl,--gc-sections",
)
ENOUGH, GIVE_UP = 3_000_000, 5_000_000
"""Instructions to list, a few seconds, and most of them before the first step."""


@dataclass(frozen=True)
class Core:
    """A kind of controller."""

    name: str
    flags: tuple[str, ...]
    arithmetic: str


CORES = (
    Core("Cortex-M4F", ("-mcpu=cortex-m4", "-mfpu=fpv4-sp-d16"), "single precision in hardware, double in software"),
    Core("Cortex-M7", ("-mcpu=cortex-m7", "-mfpu=fpv5-d16"), "single and double precision in hardware"),
)


@dataclass(frozen=True)
class Instructions:
    """Instructions of the calls that were listed, None where there are too many for one."""

    calls: int
    median: int | None
    largest: int | None

    @classmethod
    def of(cls, counts: NDArray[np.int64]) -> Self:
        """The figures of counts, one a call."""
        return cls(counts.size, int(np.median(counts)), int(counts.max())) if counts.size else cls(0, None, None)


@dataclass(frozen=True)
class ControllerCost:
    """What a step needs on one kind of controller."""

    core: Core
    flash_bytes: int
    ram_bytes: int
    """Code and constants; the axis. The stack comes on top."""
    step: Instructions
    learn: Instructions
    """Of blocks; without learning there are none."""


def cross_build(folder: Path, model: HysteresisCreepModel, settings: ExportSettings, core: Core) -> Path:
    """Build the image in a folder, without a warning; ExportError where there is no compiler or it fails."""
    compiler = tool(COMPILER, package=PACKAGES[COMPILER])
    write_files(
        folder, {**export(model, settings), **render(model, settings, files={"controller.c": "controller.c.jinja"})}
    )
    image = folder / f"{core.name}.elf"
    compiled(
        compiler,
        [*WARNINGS, *EXACT, *FLAGS, *core.flags, "controller.c", *units(folder), "-o", str(image), "-lm"],
        folder,
        f"the export for {core.name}",
    )
    return image


def image_bytes(image: Path) -> tuple[int, int]:
    """Flash and RAM of an image: code, constants and initial values; what is initialised and what is zero."""
    done = subprocess.run(
        [tool("arm-none-eabi-size", package="binutils-arm-none-eabi"), str(image)],
        capture_output=True,
        text=True,
        check=True,
    )
    text, data, bss = (int(word) for word in done.stdout.splitlines()[1].split()[:3])
    return text + data, data + bss


def instructions(image: Path, samples: ArrayLike, enough: int = ENOUGH) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Instructions of each step and of each block's learning, all that they call included, until ``enough`` are listed.

    Empty where the reset alone took GIVE_UP of them.
    """
    words = [tool(EMULATOR, package=PACKAGES[EMULATOR]), "-cpu", "max", "-singlestep", "-d", "nochain,exec", str(image)]
    entries: dict[bytes, bytes] = {}
    counts: dict[bytes, list[int]] = {b"piezo_step": [], b"piezo_learn": []}
    before, current = 0, []
    with tempfile.TemporaryFile() as source:
        source.write(np.ascontiguousarray(samples, dtype=np.float64).tobytes())
        source.seek(0)
        with subprocess.Popen(words, stdin=source, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as emulator:
            assert emulator.stderr is not None
            # A line is "Trace 0: host address [.../address/...] function"; a call begins where its first address comes
            # again.
            for listed, line in enumerate(emulator.stderr):
                function = line[line.rfind(b" ") + 1 : -1]
                if function in counts:
                    address = line.split(b"/", 2)[1]
                    if address == entries.setdefault(function, address):
                        before = before or listed
                        current = counts[function]
                        current.append(0)
                if current and function != b"_start":
                    current[-1] += 1
                if listed - before > (enough if before else GIVE_UP):
                    emulator.kill()
                    current[-1:] = []  # it had not ended
                    break
    if emulator.returncode not in (0, -signal.SIGKILL):
        raise ExportError(f"{image.name} ended with status {emulator.returncode} under {EMULATOR}")
    step, learn = (np.array(each, dtype=np.int64) for each in counts.values())
    return step, learn


def controller_cost(
    folder: Path, model: HysteresisCreepModel, settings: ExportSettings, core: Core, samples: Vector
) -> ControllerCost:
    """Build, measure and count, over as many of the samples as ENOUGH instructions allow."""
    image = cross_build(folder, model, settings, core)
    flash, ram = image_bytes(image)
    step, learn = instructions(image, samples)
    return ControllerCost(core, flash, ram, Instructions.of(step), Instructions.of(learn))
