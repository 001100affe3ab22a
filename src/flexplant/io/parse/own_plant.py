"""Plants in the project's own layout (see `flexplant.io.parse.own`)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from flexplant.errors import InputError, ModelError, ReadError
from flexplant.io.parse.files import one_line
from flexplant.io.parse.npz_matrices import csr_matrix, pack_matrix
from flexplant.io.parse.own import HEADER, Arrays, header_text, read_header
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import Descriptor, StateSpace

Plant = ModalPlant | StateSpace | Descriptor
TEXTS = ("name", "inputs", "outputs", "input_units", "output_units")
SHAPES = ("shape_in", "shape_out", "shape_out_velocity", "shape_out_acceleration", "damping", "static_correction", "feedthrough")
KINDS: dict[str, tuple[type[Any], tuple[str, ...]]] = {
    "modal_plant": (ModalPlant, ("omega", "zeta", *SHAPES)),
    "state_space": (StateSpace, tuple("ABCD")),
    "descriptor": (Descriptor, tuple("EABCD")),
}


def pack_plant(plant: Plant) -> Arrays:
    """Arrays of a plant; InputError for another type."""
    for kind, (cls, names) in KINDS.items():
        if isinstance(plant, cls):
            texts = {k: getattr(plant, k) for k in TEXTS}
            texts |= {k: getattr(plant, k) for k in ("dt", "report") if hasattr(plant, k)}
            arrays: Arrays = {HEADER: header_text(kind, **texts)}
            for name in names:
                if (matrix := getattr(plant, name)) is not None:
                    arrays |= pack_matrix(name, matrix)
            return arrays
    raise InputError(f"a ModalPlant, StateSpace or Descriptor can be written as a plant, not {type(plant).__name__}")


def unpack_plant(arrays: Arrays, path: Path) -> Plant:
    """The plant from its arrays; ReadError for anything missing or inconsistent."""
    header = read_header(arrays.get(HEADER), path)
    kind = header["kind"]
    if kind not in KINDS:
        raise ReadError(path, f"holds a {kind}, not a plant ({', '.join(KINDS)})", record=HEADER)
    cls, names = KINDS[kind]
    given = {k: header[k] for k in (*TEXTS, "dt", "report") if k in header}
    matrices = {
        n: arrays[n] if n in arrays else csr_matrix(arrays, n, path) for n in names if n in arrays or f"{n}.indptr" in arrays
    }
    try:
        plant: Plant = cls(**given, **matrices)
    except (ModelError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise ReadError(path, one_line(error)) from None
    return plant


def matlab_variables(plant: Plant) -> dict[str, Any]:
    """Variables for a `.mat` file: A, B, C, D (E), dt (0 for continuous time), names as cell columns; modal arrays."""
    from flexplant.plant.state_space import state_space

    form = state_space(plant) if isinstance(plant, ModalPlant) else plant
    out: dict[str, Any] = {k: _matlab(getattr(form, k)) for k in ("E", "A", "B", "C", "D") if hasattr(form, k)}
    out["dt"] = float(getattr(form, "dt", None) or 0.0)
    for name, texts in (("InputName", form.inputs), ("OutputName", form.outputs)):
        out[name] = _cells(texts)
    for name, texts in (("InputUnit", form.input_units), ("OutputUnit", form.output_units)):
        out[name] = _cells(texts)
    out["Name"] = plant.name
    if isinstance(plant, ModalPlant):
        modal = {n: getattr(plant, n) for n in KINDS["modal_plant"][1]}
        out |= {n: a.reshape(-1, 1) if a.ndim == 1 else a for n, a in modal.items() if a is not None}
        out["mechanical"] = _mechanical(plant)
    return out


def _mechanical(plant: ModalPlant) -> dict[str, Any]:
    """M x'' + C x' + K x = B u, y = F x + G x' + D u, the names and order of MATLAB's mechss."""
    from flexplant.plant.state_space import output_rows

    position, velocity, direct = output_rows(plant)
    second = {"M": np.eye(plant.n_modes), "C": plant.damping_matrix, "K": np.diag(plant.omega**2), "B": plant.shape_in}
    return second | {"F": position, "G": velocity, "D": direct}


def _matlab(matrix: Any) -> Any:
    return sp.csc_matrix(matrix) if sp.issparse(matrix) else np.asarray(matrix)


def _cells(texts: Any) -> Any:
    column = np.empty((len(texts), 1), dtype=object)
    column[:, 0] = list(texts)
    return column
