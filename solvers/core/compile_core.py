"""Compiles the C cores into extension modules, one for each instruction set; ``python solvers/core/compile_core.py``
does it in place.

It needs a C compiler that knows gcc's vector types (gcc, clang or the package ziglang) and neither Python.h nor any
package, since it runs before the project is installed.
"""

import argparse
import hashlib
import importlib.util
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

CORES = ("solvers", "piezo_model")
"""Packages with a folder ``core`` of C; each may call the C of the packages before it."""
BESIDE = {"solvers": ("kernel",), "piezo_model": ("plants",)}
"""Other folders of a package whose C is part of its library."""
ROOT = Path(__file__).resolve().parents[2]
PACKAGES = tuple(ROOT / name for name in CORES)
ZIGLANG = "ziglang==0.17.1"
"""The compiler of the build on a machine without one."""
FLAGS = (
    "-std=c99",
    "-O3",
    "-ffp-contract=off",
    "-fno-math-errno",
    "-fno-trapping-math",
    "-fPIC",
    "-fvisibility=hidden",
)
"""Without -ffast-math and fused products, the bits of an answer depend on the sources alone."""
SANITIZERS = ("-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
PROBE = """typedef double four __attribute__((vector_size(32)));
#include <math.h>
#include <string.h>
four sum(four a, four b);
four sum(four a, four b) { a[0] = sqrt(a[0]); return a + b; }
"""


class NoCompiler(RuntimeError):
    """There is no C compiler; the message is one sentence."""


def instruction_sets() -> tuple[str, ...]:
    """The instruction sets to build on this kind of machine: levels of x86-64, or the base set of another
    processor."""
    return ("v2", "v3", "v4") if platform.machine().lower() in ("x86_64", "amd64") else ("native",)


def library(package: Path, instructions: str) -> Path:
    """Path of the extension module of a package for an instruction set."""
    suffix = ".pyd" if sys.platform == "win32" else ".abi3.so"
    return package / "core" / f"_core_{instructions}{suffix}"


def folders(package: Path) -> list[Path]:
    """The folders of C from which a package is built: its own, and the cores of the packages below it."""
    cores = [package.parent / name / "core" for name in CORES[: CORES.index(package.name) + 1]]
    return cores + [package / name for name in BESIDE.get(package.name, ())]


def digest(package: Path) -> str:
    """A hash of the sources of a package's core, which is compiled into the library and compared at import."""
    total = hashlib.sha256()
    for folder in folders(package):
        for file in sorted((*folder.glob("*.[ch]"), *folder.glob("compile_core.py"))):
            total.update(file.name.encode() + b"\0" + file.read_bytes().replace(b"\r\n", b"\n"))
    return total.hexdigest()[:16]


def compiler() -> list[str]:
    """The command of the first C compiler that compiles vector types: $CC, cc, gcc, clang, or the package ziglang.

    Raises
    ------
    NoCompiler
        There is none.
    """
    candidates = [shlex.split(os.environ["CC"])] if os.environ.get("CC") else []
    candidates += [[path] for name in ("cc", "gcc", "clang") if (path := shutil.which(name))]
    if importlib.util.find_spec("ziglang"):
        candidates.append([sys.executable, "-m", "ziglang", "cc"])
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder, "probe.c")
        source.write_text(PROBE, encoding="utf-8")
        for command in candidates:
            attempt = [*command, *FLAGS, "-shared", str(source), "-o", str(source.with_suffix(".so")), *_libraries()]
            if subprocess.run(attempt, capture_output=True, check=False).returncode == 0:
                return command
    raise NoCompiler(f"no working C compiler: install gcc or clang, or run pip install {ZIGLANG}")


def build(package: Path, target: Path, *, debug: bool = False) -> list[Path]:
    """Compile the core of a package for every instruction set into the folder ``target``; returns the libraries.

    Raises
    ------
    NoCompiler
        There is no C compiler.
    subprocess.CalledProcessError
        The compiler refuses the sources.
    """
    command, target = compiler(), target.resolve()
    target.mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        futures = [pool.submit(_compile, package, target, command, isa, debug) for isa in instruction_sets()]
    return [future.result() for future in futures]


def _compile(package: Path, target: Path, command: list[str], instructions: str, debug: bool) -> Path:
    """Compile and link the library for an instruction set; ``module.c``, which detects that of the processor, is
    compiled for all processors."""
    made = target / library(package, instructions).name
    zig = "ziglang" in command
    name = instructions.replace("v", "x86_64_v" if zig else "x86-64-v")
    machine = [] if instructions == "native" else [f"-{'mcpu' if zig else 'march'}={name}"]
    own = package / "core" / "module.c"
    others = [file for folder in folders(package) for file in sorted(folder.glob("*.c")) if file.name != own.name]
    others = [file for file in others if package in file.parents or not file.name.startswith("bindings_")]
    flags = [*FLAGS, *(f"-I{folder}" for folder in folders(package)), *(SANITIZERS if debug else ())]
    words = {"CORE_SOURCES": digest(package), "CORE_COMPILER": _version(command), "CORE_INSTRUCTIONS": instructions}
    sources = {own: [f'-D{key}="{value}"' for key, value in words.items()], **dict.fromkeys(others, machine)}
    with tempfile.TemporaryDirectory() as scratch:
        objects = [str(Path(scratch, f"{file.stem}.o")) for file in sources]
        for target_file, (file, options) in zip(objects, sources.items(), strict=True):
            subprocess.run([*command, *flags, *options, "-c", str(file), "-o", target_file], check=True)
        linked = Path(scratch, made.name)
        subprocess.run([*command, "-shared", *flags, *objects, "-o", str(linked), *_libraries()], check=True)
        shutil.copyfile(linked, made.with_suffix(".new"))
    made.with_suffix(".new").replace(made)  # in one step: another process may have the old one open
    return made


def _libraries() -> list[str]:
    if sys.platform == "win32":
        return [f"-L{Path(sys.base_prefix, 'libs')}", "-lpython3"]
    return ["-undefined", "dynamic_lookup"] if sys.platform == "darwin" else ["-lm"]


def _version(command: list[str]) -> str:
    text = subprocess.run([*command, "--version"], capture_output=True, text=True, check=True).stdout
    return text.splitlines()[0].replace('"', "")


def up_to_date(package: Path) -> bool:
    """Whether every library of a package exists and was built from the present sources."""
    paths, stamp = [library(package, isa) for isa in instruction_sets()], digest(package).encode()
    return all(path.exists() and stamp in path.read_bytes() for path in paths)


def main() -> None:
    """Build the libraries that are not up to date, in place."""
    arguments = argparse.ArgumentParser(description="Compile the C cores in place.")
    arguments.add_argument("--debug", action="store_true", help="with sanitizers")
    arguments.add_argument("--fresh", action="store_true", help="also if they are up to date")
    chosen = arguments.parse_args()
    for package in PACKAGES:
        if chosen.debug or chosen.fresh or not up_to_date(package):
            try:
                paths = build(package, package / "core", debug=chosen.debug)
            except NoCompiler as error:
                sys.exit(str(error))
            print(f"built {', '.join(str(path.relative_to(ROOT)) for path in paths)}")


if __name__ == "__main__":
    main()
