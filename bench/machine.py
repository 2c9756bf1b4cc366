"""What a run was measured on: machine, versions, and what disturbs timing there."""

from __future__ import annotations

import importlib.metadata
import os
import platform
from pathlib import Path
from typing import Any

PACKAGES = ("piezobench", "numpy", "scipy", "numba", "qpsolvers", "pandas")


def describe() -> dict[str, Any]:
    """Machine and versions as JSON can hold them."""
    return {"processor": processor(), "cores": os.cpu_count(), "system": platform.platform(),
            "python": platform.python_version(),
            "versions": {name: importlib.metadata.version(name) for name in PACKAGES},
            "load_at_start": list(os.getloadavg()), "warnings": warnings()}


def processor() -> str:
    """Model name of the processor, as far as the system says it."""
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def warnings() -> list[str]:
    """Sentences about what makes times on this machine less certain."""
    found = []
    governor = Path("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")
    if governor.is_file() and governor.read_text().strip() != "performance":
        found.append(f"The frequency governor is {governor.read_text().strip()!r}, so the clock rate varies.")
    elif not governor.is_file():
        found.append("The system does not say how it governs the clock rate.")
    info = Path("/proc/cpuinfo")
    if info.is_file() and "hypervisor" in info.read_text(encoding="utf-8", errors="replace"):
        found.append("This is a virtual machine, so neighbours may take time from it.")
    if os.getloadavg()[0] > 0.5:
        found.append(f"The machine was busy at the start (load {os.getloadavg()[0]:.1f}).")
    return found
