"""Files of a study, written so that a failure or Ctrl-C leaves nothing half-written."""

from __future__ import annotations

import inspect
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from flexplant.assembly import System
from flexplant.errors import InputError, WriteError, nearest
from flexplant.io import read_plant, write_plant
from flexplant.io.output import check_target, plant_endings, writers
from flexplant.io.parse.own import header_text
from flexplant.io.parse.own_readers import HEADER
from flexplant.io.write.atomic import replacing
from flexplant.io.write.ownership import check_replaced, files_of


@contextmanager
def output_folder(folder: str | Path) -> Iterator[Path]:
    """A hidden work folder inside `folder`; its files appear in `folder` together when the block ends without an error.

    The folder is made where it does not exist. Raises WriteError, before any work, where it cannot be written.
    """
    folder = Path(folder)
    new = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        work = Path(tempfile.mkdtemp(prefix=".partial-", dir=folder))
    except OSError as error:
        raise WriteError(f"cannot write results to {folder} ({error.strerror}); choose another folder with -o") from None
    try:
        yield work
        for file in sorted(work.iterdir()):
            _publish(file, folder / file.name)
    finally:
        shutil.rmtree(work, ignore_errors=True)
        if new and not any(folder.iterdir()):
            folder.rmdir()


def _publish(file: Path, target: Path) -> None:
    try:
        file.replace(target)
    except OSError as error:
        raise WriteError(f"cannot write {target} ({error.strerror})") from None


def refuse_sources(names: Iterable[str], folder: str | Path, sources: Iterable[str | Path]) -> None:
    """Raise WriteError where one of the files to be written in the folder is one that the study reads."""
    read = [Path(source) for source in sources]
    for target in (Path(folder) / name for name in names):
        if target.is_file() and any(source.is_file() and source.samefile(target) for source in read):
            raise WriteError(f"{target} is a file that this study reads, and would be replaced; choose another folder with -o")


def require_folder_of(path: Path) -> None:
    """Raise WriteError where the file's folder does not exist: before a long computation, not after it."""
    if not path.parent.is_dir():
        raise WriteError(f"cannot write {path}: there is no folder {path.parent}")


def check_component_target(
    path: Path, sources: Iterable[str | Path], *, interior: bool, recovery: bool, basis: bool, overwrite: bool
) -> None:
    """Refuse a component file that cannot be written, or holds no interior DOF, recovery or basis, before a long computation.

    Raises WriteError and InputError as `check_target` and `write_component` do.
    """
    require_folder_of(path)
    chosen = check_target("write_component", path, sources, overwrite=overwrite)
    wanted = {"interior DOF (loads)": interior and "interior" not in chosen.holds}
    wanted["recovery rows (recover)"] = recovery and "recovery" not in chosen.holds
    wanted["basis"] = basis and "basis" not in inspect.signature(chosen.writers["write_component"]).parameters
    if lost := [what for what, refused in wanted.items() if refused]:
        raise InputError(f"{path.name!r}: this format does not hold the {lost[0]}; write .npz or .h5, or leave it out")


def write_new(path: str | Path, text: str) -> Path:
    """Write a text file that must not exist yet; WriteError otherwise."""
    path = Path(path)
    if path.exists():
        raise WriteError(f"{path} exists already; choose another name, nothing was overwritten")
    with replacing(path) as work:
        work.write_text(text, encoding="utf-8")
    return path


def check_system_target(path: Path, sources: Iterable[str | Path] = (), *, overwrite: bool = False) -> None:
    """Raise InputError for another ending than .npz, WriteError where this would replace a source or somebody else's file."""
    if path.suffix != ".npz":
        raise InputError(f"coupled matrices are written as .npz, got {path.name!r}")
    check_replaced(writers()["flexplant_npz"], "write_system", path, sources, overwrite)


def write_system(system: System, path: str | Path, *, overwrite: bool = False) -> Path:
    """Coupled mass, damping, stiffness and, where there is some, structural damping as triplets (row, column, value from 0),
    constraint rows and names, in one .npz."""
    path = Path(path)
    check_system_target(path, [file for c in system.components for file in files_of(c)], overwrite=overwrite)
    arrays: dict[str, Any] = {
        HEADER: header_text("system"),
        "method": system.method,
        "labels": system.labels,
        "constraints": list(system.constraint_labels),
    }
    structural = () if system.structural_damping is None else ("structural_damping",)
    for name in ("mass", "damping", "stiffness", *structural):
        matrix = sp.coo_array(getattr(system, name))
        arrays |= {f"{name}_row": matrix.row, f"{name}_column": matrix.col, f"{name}_value": matrix.data}
        arrays["shape"] = matrix.shape
    with replacing(path) as work:
        np.savez_compressed(work, **arrays)
    return path


def export_plant(plant: Path, to: str, output: Path | None, *, overwrite: bool = False, **options: Any) -> Path:
    """Read a plant file and write it in the format with the ending `to`; options: of that format (`write_plant`).

    Raises InputError for an unknown format or option, WriteError before reading where the folder does not exist, or where a
    file would be replaced that is the plant itself or, unless overwrite, somebody else's.
    """
    formats = plant_endings()
    if to not in formats:
        raise InputError(f"unknown format {to!r}." + nearest(to, formats))
    target = output or plant.with_suffix(f".{to}")
    if target.suffix.lower() != f".{to}":
        raise InputError(f"{target.name!r} does not end with .{to}, the format that was asked for")
    if target.resolve() == plant.resolve():
        raise InputError(f"{plant} is that file already; name another with -o")
    require_folder_of(target)
    check_target("write_plant", target, [plant], overwrite=overwrite)
    return write_plant(read_plant(plant), target, overwrite=overwrite, sources=[plant], **options)
