"""The machine of a run: processor, versions, and disturbances of the timing.

Some disturbances are known beforehand (:func:`warnings`); others follow from :func:`counters` before and after a part
of the race: time that a hypervisor gave to others, throttled cores, and load by other processes.
"""

import hashlib
import importlib.metadata
import json
import os
import platform
import re
import subprocess
import time
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from threadpoolctl import threadpool_info

from solvers.core import bindings

INSTRUCTION_SETS = {"v2": "SSE4.2", "v3": "AVX2", "v4": "AVX-512"}
"""Instruction sets of the levels of x86-64."""
CPU, CPU_INFO = Path("/sys/devices/system/cpu"), Path("/proc/cpuinfo")
PACKAGES = ("piezobench", "numpy", "scipy", "qpsolvers", "pandas")


@cache
def describe() -> dict[str, Any]:
    """Machine, versions and instruction set, as they were when this process first asked."""
    known = environment()
    return {
        "processor": processor(),
        "cores": os.cpu_count(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "core": core(),
        "versions": {name: importlib.metadata.version(name) for name in PACKAGES},
        "environment": known,
        "load_at_start": list(os.getloadavg()),
        "warnings": warnings(known["governor"]),
    }


def key(described: Mapping[str, Any]) -> str:
    """Key of a machine in the rows that it made: the same as long as machine, versions and instruction set are."""
    lasting = {name: value for name, value in described.items() if name not in ("load_at_start", "warnings")}
    return hashlib.sha256(json.dumps(lasting, sort_keys=True).encode()).hexdigest()[:16]


def environment() -> dict[str, str]:
    """Properties by which a later run is compared: the commit of the checkout, all installed packages, the libraries of
    linear algebra, and the settings of the processor; "" for what is not known."""
    settings = {
        "governor": CPU / "cpu0/cpufreq/scaling_governor",
        "smt": CPU / "smt/control",
        "turbo": CPU / "intel_pstate/no_turbo",
        "boost": CPU / "cpufreq/boost",
    }
    installed = {str(package.metadata["Name"]): package.version for package in importlib.metadata.distributions()}
    return {
        "commit": commit(),
        "packages": ", ".join(f"{name}=={version}" for name, version in sorted(installed.items())),
        "blas": ", ".join(
            f"{package['internal_api']} {package['version']} {package.get('architecture', '')}".strip()
            for package in threadpool_info()
        ),
        **{name: text_of(path) for name, path in settings.items()},
    }


def commit() -> str:
    """The commit of the current folder's checkout, or else of the one that this program runs from, with + if a file
    differs from it; "" without either."""
    own = Path(__file__).parents[2]
    words = ["-c", "core.fsmonitor=false", "describe", "--always", "--abbrev=40", "--exclude=*", "--dirty=+"]
    for root in (Path.cwd(), *([own] if (own / ".git").exists() else [])):
        with suppress(OSError, subprocess.SubprocessError):  # without git, a checkout, or in that of another user
            return subprocess.run(
                ["git", "-C", str(root), *words], capture_output=True, text=True, timeout=10, check=True
            ).stdout.strip()
    return ""


def name(described: Mapping[str, Any]) -> str:
    """Processor, number of cores, and instruction set and compiler of our core, from a description.

    Examples
    --------
    >>> name({"processor": "AMD EPYC", "cores": 2, "core": "AVX2, gcc 12.2.0"})
    'AMD EPYC, 2 cores, AVX2, gcc 12.2.0'
    """
    return f"{described['processor']}, {described['cores']} core{'s' * (described['cores'] != 1)}, {described['core']}"


@cache
def here() -> str:
    """Name of this machine."""
    return name({"processor": processor(), "cores": os.cpu_count(), "core": core()})


def elsewhere(what: str, there: Collection[str]) -> list[str]:
    """A sentence if ``what`` was measured on other machines than this one, which are named."""
    sentence = (
        f"{what} was measured on another machine, {' and '.join(there)}. Times on this one, {here()}, differ: race "
        "here, too."
    )
    return [] if here() in there else [sentence]


def core() -> str:
    """Instruction set and compiler of our C core."""
    return f"{INSTRUCTION_SETS.get(bindings.instructions, bindings.instructions)}, {bindings.compiler}"


def text_of(path: Path) -> str:
    """The text of one of the system's files; "" if there is none."""
    return path.read_text(encoding="utf-8", errors="replace").strip() if path.is_file() else ""


def processor() -> str:
    """Model name of the processor, if the system reports it."""
    named = re.search(r"^model name\s*:(.*)", text_of(CPU_INFO), re.MULTILINE)
    return named[1].strip() if named else platform.processor() or platform.machine()


def warnings(governor: str) -> list[str]:
    """Sentences about conditions that make times on this machine less certain; ``governor`` is that of the frequency,
    "" if it is unknown."""
    load = os.getloadavg()[0]
    conditions = (
        (not governor, "Frequency governor unknown."),
        (
            governor not in ("", "performance"),
            f"The frequency governor is {governor!r}, so the clock rate varies.",
        ),
        ("hypervisor" in text_of(CPU_INFO), "This is a virtual machine, so neighbours may take time from it."),
        (load > 0.5, f"The machine was busy at the start (load {load:.1f})."),
    )
    return [sentence for holds, sentence in conditions if holds]


TOLERATED_STEAL = 0.5
"""Largest share of the machine's time, in per cent, that a hypervisor may give to others without a warning."""
TOLERATED_NEIGHBOURS = 0.25
"""Largest mean number of cores that other processes may keep busy without a warning."""
TOLERATED_PREEMPTIONS = 1e-3
"""Largest number of preemptions for each timed call without a warning."""


def counters() -> dict[str, float]:
    """The system's counters; zero if it has none.

    ``seconds`` is the monotonic clock. ``stolen``, ``busy`` and ``ticks`` are clock ticks of all cores: given to others
    by a hypervisor, spent working, and all. ``throttled`` counts how often a core
    was throttled.
    """
    # user nice system idle iowait irq softirq steal of all cores, then guests, who are in user already
    times = [int(number) for number in text_of(Path("/proc/stat")).partition("\n")[0].split()[1:9]] or [0] * 8
    ticks, stolen = sum(times), times[7]
    return {
        "seconds": time.monotonic(),
        "stolen": stolen,
        "busy": ticks - stolen - times[3] - times[4],
        "ticks": ticks,
        "throttled": sum(int(path.read_text()) for path in CPU.glob("cpu[0-9]*/thermal_throttle/core_throttle_count")),
    }


def between(before: Mapping[str, float], after: Mapping[str, float]) -> dict[str, float]:
    """Differences of two readings of the counters; ``busy_cores`` is the mean number of working cores."""
    change = {name: after[name] - before[name] for name in after}
    return {
        "seconds": change["seconds"],
        "throttled": change["throttled"],
        "steal_percent": 100.0 * change["stolen"] / max(change["ticks"], 1),
        "busy_cores": change["busy"] / os.sysconf("SC_CLK_TCK") / max(change["seconds"], 1e-9),
    }


def disturbances(parts: Sequence[Mapping[str, Any]]) -> list[str]:
    """Sentences about the disturbances of a race, from the differences in its parts by :func:`between`.

    Each part has also ``host`` and ``core``, and may have ``preemptions`` and ``timed_calls``. A race keeps each of its
    cores of a host busy itself.

    Examples
    --------
    >>> part = {"host": "a", "core": 0, "seconds": 60.0, "throttled": 0, "steal_percent": 2.0, "busy_cores": 1.0}
    >>> disturbances([part])
    ['CPU steal 2.0 % while solvers were timed.']
    """
    seconds = max(sum(part["seconds"] for part in parts), 1e-9)
    steal = sum(part["steal_percent"] * part["seconds"] for part in parts) / seconds
    own = Counter(host for host, _ in {(part["host"], part["core"]) for part in parts})
    neighbours = sum((part["busy_cores"] - own[part["host"]]) * part["seconds"] for part in parts) / seconds
    throttled, preemptions, calls = (
        sum(part.get(name, 0) for part in parts) for name in ("throttled", "preemptions", "timed_calls")
    )
    found = (
        (steal > TOLERATED_STEAL, f"CPU steal {steal:.1f} % while solvers were timed."),
        (throttled, f"The processor throttled {throttled:.0f} times."),
        (neighbours > TOLERATED_NEIGHBOURS, f"Other processes kept {neighbours:.1f} cores busy beside the race."),
        (preemptions > TOLERATED_PREEMPTIONS * calls, f"{preemptions:.0f} preemptions in {calls:.0f} timed calls."),
    )
    return [sentence for is_disturbed, sentence in found if is_disturbed]
