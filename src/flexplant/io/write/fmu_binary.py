"""The shared library inside an FMU, for the computer that writes it."""

from __future__ import annotations

import platform
import shutil
import subprocess
import tempfile
from pathlib import Path

from flexplant.errors import WriteError

COMPILERS = ("cc", "gcc", "clang")
FLAGS = ("-std=c99", "-O3", "-ffp-contract=off", "-Wall", "-Werror", "-fPIC", "-fvisibility=hidden", "-shared")
LIBRARIES = {"Linux": ("linux", ".so"), "Darwin": ("darwin", ".dylib"), "Windows": ("win", ".dll")}
SYSTEMS = {"Linux": "linux", "Darwin": "darwin", "Windows": "windows"}
MACHINES = {"AMD64": "x86_64", "amd64": "x86_64", "arm64": "aarch64", "i386": "x86", "i686": "x86"}
COMPILE_SECONDS = 300


def platform_folder(version: int) -> str:
    """The folder of this computer in an FMU: linux64 (FMI 2.0) or x86_64-linux (FMI 3.0); "" where there is none."""
    system = platform.system()
    if system not in LIBRARIES:
        return ""
    if version == 3:
        return f"{MACHINES.get(platform.machine(), platform.machine())}-{SYSTEMS[system]}"
    return LIBRARIES[system][0] + ("64" if platform.architecture()[0] == "64bit" else "32")


def shared_library(source: str, model: str, version: int, *, required: bool) -> dict[str, bytes]:
    """Name in the archive and content; nothing where there is no compiler and none is required.

    Raises WriteError where a library is required and there is no compiler, or the compiler fails.
    """
    compiler = next((c for c in map(shutil.which, COMPILERS) if c), None)
    folder = platform_folder(version)
    if compiler is None or not folder:
        if required:
            raise WriteError(f"no C compiler found ({', '.join(COMPILERS)}); install one, or pass binary=False for sources only")
        return {}
    ending = LIBRARIES[platform.system()][1]
    with tempfile.TemporaryDirectory() as work:
        code, library = Path(work) / f"{model}.c", Path(work) / f"{model}{ending}"
        code.write_text(source, encoding="utf-8")
        command = [compiler, *FLAGS, "-o", str(library), str(code)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=COMPILE_SECONDS, check=False)
        if done.returncode:
            raise WriteError(f"{compiler} could not compile the FMU: {done.stderr[:500]}")
        return {f"binaries/{folder}/{model}{ending}": library.read_bytes()}
