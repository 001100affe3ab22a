"""A modal plant as an FMU: FMI 2.0 co-simulation, compiled C inside with its source, no run-time dependency.

Each mode advances exactly for inputs that are held over a communication step of any length: the 2x2 transition of every
mode is computed when the step changes. Outputs follow inputs directly where the plant does (feedthrough).
Standard: FMI 2.0.4, Modelica Association.
"""

from __future__ import annotations

import hashlib
import platform
import shutil
import subprocess
import tempfile
import zipfile
from pathlib import Path
from string import Template
from xml.sax.saxutils import quoteattr

import numpy as np

from flexplant.errors import InputError, WriteError
from flexplant.io.formats import Writer
from flexplant.io.parse.own_plant import Plant
from flexplant.io.write.c_text import comment, definition, identifier
from flexplant.io.write.fmu_templates import SOURCE
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import output_rows

COMPILERS = ("cc", "gcc", "clang")
LIBRARIES = {"Linux": ("linux", ".so"), "Darwin": ("darwin", ".dylib"), "Windows": ("win", ".dll")}
COMPILE_SECONDS = 300
EPOCH = (1980, 1, 1, 0, 0, 0)  # so that the same plant gives the same file


def write_plant(plant: Plant, path: Path, *, target: Path, name: str | None = None, binary: bool | None = None) -> None:
    """The FMU of a ModalPlant with modal damping.

    name: model identifier, None for the file's stem. binary: with the library for this computer; None where a C compiler
    is found (the sources are there either way, and importers can compile them).
    Raises InputError for other plants, WriteError where a binary was asked for and cannot be made.
    """
    if not isinstance(plant, ModalPlant) or plant.damping is not None:
        raise InputError(f"an FMU needs a ModalPlant with modal damping (off_diagonal_damping='drop'), got {_what(plant)}")
    if not plant.inputs or not plant.outputs:
        raise InputError(f"plant {plant.name!r}: an FMU needs at least one input and one output")
    model = identifier(name or target.stem)
    source = fmu_source(plant)
    guid = hashlib.sha256(source.encode()).hexdigest()[:32]
    source = source.replace("@guid@", guid)
    members = {"modelDescription.xml": description(plant, model, guid).encode(), f"sources/{model}.c": source.encode()}
    if binary is not False and (library := _compiled(source, model, required=binary is True)) is not None:
        members[library[0]] = library[1]
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for member, content in members.items():
            info = zipfile.ZipInfo(member, EPOCH)
            info.compress_type, info.external_attr = zipfile.ZIP_DEFLATED, 0o755 << 16
            archive.writestr(info, content)


def _what(plant: object) -> str:
    return "a full damping matrix" if isinstance(plant, ModalPlant) else type(plant).__name__


def fmu_source(plant: ModalPlant) -> str:
    """The C file, with the guid still to be filled in."""
    position, velocity, direct = output_rows(plant)
    tables = {"omega": plant.omega, "zeta": plant.zeta, "shape_in": plant.shape_in.T}
    tables |= {"position_out": position.T, "velocity_out": velocity.T}
    n = max(plant.n_modes, 1)
    if plant.n_modes == 0:
        tables = {k: np.zeros([1 if s == 0 else s for s in v.shape]) for k, v in tables.items()}
    text = "".join(definition("double", k, v) for k, v in (tables | {"direct": direct}).items())
    words = {"title": comment(plant.name), "n": n, "nu": len(plant.inputs), "ny": len(plant.outputs), "tables": text}
    return Template(SOURCE).substitute(words)


def description(plant: ModalPlant, model: str, guid: str) -> str:
    """modelDescription.xml: inputs first, then outputs, value references in that order."""
    first, units = len(plant.inputs), [*plant.input_units, *plant.output_units]
    names = [*plant.inputs, *plant.outputs]
    listed = [_variable(i, names[i], units[i], "input" if i < first else "output") for i in range(len(names))]
    unknowns = "\n".join(f'      <Unknown index="{first + i + 1}"/>' for i in range(len(plant.outputs)))
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName={quoteattr(plant.name)} guid="{guid}"
  generationTool="flexplant" variableNamingConvention="flat" numberOfEventIndicators="0">
  <CoSimulation modelIdentifier="{model}" canHandleVariableCommunicationStepSize="true" canGetAndSetFMUstate="true"
    canBeInstantiatedOnlyOncePerProcess="false" needsExecutionTool="false">
    <SourceFiles>
      <File name="{model}.c"/>
    </SourceFiles>
  </CoSimulation>
  <ModelVariables>
{chr(10).join(listed)}
  </ModelVariables>
  <ModelStructure>
    <Outputs>
{unknowns}
    </Outputs>
    <InitialUnknowns>
{unknowns}
    </InitialUnknowns>
  </ModelStructure>
</fmiModelDescription>
"""


def _variable(reference: int, name: str, unit: str, causality: str) -> str:
    about = f" description={quoteattr(unit)}" if unit else ""
    start = ' start="0"' if causality == "input" else ""
    initial = ' initial="calculated"' if causality == "output" else ""
    head = f'    <ScalarVariable name={quoteattr(name)} valueReference="{reference}" causality="{causality}"'
    return f'{head} variability="continuous"{initial}{about}><Real{start}/></ScalarVariable>'


def _compiled(source: str, model: str, required: bool) -> tuple[str, bytes] | None:
    """Name in the archive and content of the shared library; None where there is no compiler and none is required."""
    compiler = next((c for c in map(shutil.which, COMPILERS) if c), None)
    system, ending = LIBRARIES.get(platform.system(), ("", ""))
    if compiler is None or not system:
        if required:
            raise WriteError(f"no C compiler found ({', '.join(COMPILERS)}); install one, or pass binary=False for sources only")
        return None
    with tempfile.TemporaryDirectory() as folder:
        code, library = Path(folder) / f"{model}.c", Path(folder) / f"{model}{ending}"
        code.write_text(source, encoding="utf-8")
        command = [compiler, "-std=c99", "-O3", "-Wall", "-Werror", "-fPIC", "-shared", "-o", str(library), str(code)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=COMPILE_SECONDS, check=False)
        if done.returncode:
            raise WriteError(f"{compiler} could not compile the FMU: {done.stderr[:500]}")
        bits = "64" if platform.architecture()[0] == "64bit" else "32"
        return f"binaries/{system}{bits}/{model}{ending}", library.read_bytes()


WRITER = Writer(
    name="fmu",
    description="FMU, FMI 2.0 co-simulation, compiled C and its source inside",
    suffixes=(".fmu",),
    tested_against="FMPy 0.3",
    writers={"write_plant": write_plant},
)
