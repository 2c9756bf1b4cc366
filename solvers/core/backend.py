"""The PEP 517 backend: setuptools with the C cores, and with the package ziglang on a machine without a C compiler."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import compile_core
from setuptools.build_meta import *  # noqa: F403 (the hooks that stay as they are)
from setuptools.command.build_ext import build_ext


class BuildCore(build_ext):
    """``build_ext`` that compiles the cores, in place for an editable install."""

    def run(self) -> None:
        """Compile the cores that are not up to date."""
        for package in compile_core.PACKAGES:
            if not compile_core.up_to_date(package):
                compile_core.build(package, package / "core")
        if not (self.inplace or self.editable_mode):
            for made, target in zip(_libraries(), self.get_outputs(), strict=True):
                Path(target).parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(made, target)

    def get_outputs(self) -> list[str]:
        """The libraries of the wheel."""
        return [str(Path(self.build_lib, made.relative_to(compile_core.ROOT))) for made in _libraries()]

    def get_output_mapping(self) -> dict[str, str]:
        """Nothing to link: an editable install has its libraries in place."""
        return {}


def _libraries() -> list[Path]:
    return [
        compile_core.library(package, isa)
        for package in compile_core.PACKAGES
        for isa in compile_core.instruction_sets()
    ]


def get_requires_for_build_wheel(config_settings: dict[str, Any] | None = None) -> list[str]:
    """A compiler if there is none."""
    try:
        compile_core.compiler()
    except compile_core.NoCompiler:
        return [compile_core.ZIGLANG]
    return []


get_requires_for_build_editable = get_requires_for_build_wheel
