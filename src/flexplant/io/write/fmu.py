"""A plant as an FMU: FMI 2.0 or 3.0 co-simulation, compiled C inside with its source, no run-time dependency.

A continuous plant takes communication steps of any size exactly, with inputs held over the step (or linear, where an
importer of FMI 2.0 sets input derivatives); a discrete one whole multiples of its sample time. Modal plants advance by
modes, others by blocks of two states (`block_form`) where they can be taken apart, else by a full matrix.
Standards: FMI 2.0.5 and 3.0.2, Modelica Association.
"""

from __future__ import annotations

import hashlib
import zipfile
from pathlib import Path

from flexplant.errors import InputError
from flexplant.io.formats import Writer
from flexplant.io.parse.own_plant import Plant
from flexplant.io.write.block_form import export_form
from flexplant.io.write.c_text import identifier
from flexplant.io.write.fmu_binary import shared_library
from flexplant.io.write.fmu_description import About, build_description, description_2, description_3
from flexplant.io.write.fmu_source import fmu_source

EPOCH = (1980, 1, 1, 0, 0, 0)  # so that the same plant gives the same file
VERSIONS = (2, 3)


def write_plant(
    plant: Plant,
    path: Path,
    *,
    target: Path,
    version: int = 2,
    arrays: bool = True,
    dt: float | None = None,
    name: str | None = None,
    binary: bool | None = None,
) -> None:
    """The FMU of a ModalPlant, StateSpace or Descriptor with regular E.

    version: 2 (one variable a channel) or 3. arrays: of version 3, inputs and outputs as arrays u and y with the constants
    u.names, u.units, y.names, y.units; False for one variable a channel. Variables of an input and an output that share a
    name, as a force and the displacement under it do, end in ":in" and ":out". dt: communication step to suggest, seconds.
    name: model identifier, None for the file's stem. binary: with the library for this computer; None where a C compiler
    is found (the sources are there either way, and importers can compile them).
    Raises InputError for other plants and choices, WriteError where a binary was asked for and cannot be made.
    """
    if not isinstance(version, int) or version not in VERSIONS:
        raise InputError(f"version={version!r:.60}: FMUs are written for FMI 2.0 or 3.0; pass version=2 or version=3")
    if dt is not None and not 0 < dt < float("inf"):
        raise InputError(f"dt = {dt!r}: the communication step to suggest must be a positive number of seconds")
    form = export_form(plant)
    if dt is not None and form.dt is not None and abs(dt - form.dt) > 1e-12 * dt:
        raise InputError(f"plant {plant.name!r} is discrete with dt = {form.dt} s, so it cannot be written for dt = {dt} s")
    model = identifier(name or target.stem)
    source = fmu_source(plant, form, version, arrays)
    token = hashlib.sha256(source.encode()).hexdigest()[:32]
    source = source.replace("@token@", token)
    about = About(model, token, plant, form.d, form.dt, dt)
    members = {"modelDescription.xml": description_2(about) if version == 2 else description_3(about, arrays)}
    members[f"sources/{model}.c"] = source
    if version == 3:
        members["sources/buildDescription.xml"] = build_description(model)
    library = {} if binary is False else shared_library(source, model, version, required=binary is True)
    _pack(path, {k: v.encode() for k, v in members.items()} | library)


def _pack(path: Path, members: dict[str, bytes]) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for member, content in members.items():
            info = zipfile.ZipInfo(member, EPOCH)
            info.compress_type, info.external_attr = zipfile.ZIP_DEFLATED, 0o755 << 16
            archive.writestr(info, content)


WRITER = Writer(
    name="fmu",
    description="FMU, FMI 2.0 or 3.0 co-simulation, compiled C and its source inside",
    suffixes=(".fmu",),
    tested_against="FMPy 0.3; compiled by gcc, clang, MinGW",
    writers={"write_plant": write_plant},
)
