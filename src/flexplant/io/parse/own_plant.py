"""Plants in the project's own layout (see `flexplant.io.parse.own`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import scipy.sparse as sp

from flexplant.errors import InputError, ModelError, ReadError
from flexplant.io.parse.files import one_line
from flexplant.io.parse.npz_matrices import csr_matrix, pack_matrix
from flexplant.io.parse.own import Arrays, header_text, read_header
from flexplant.io.parse.own_readers import HEADER
from flexplant.model.arrays import FloatArray
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
            texts |= {"source": plant.source} if plant.source else {}
            arrays: Arrays = {HEADER: header_text(kind, **texts)}
            for name in names:
                if (matrix := getattr(plant, name)) is not None:
                    arrays |= pack_matrix(name, matrix)
            return arrays
    raise InputError(f"a ModalPlant, StateSpace or Descriptor can be written as a plant, not {type(plant).__name__}")


def unpack_plant(arrays: Arrays, path: Path) -> Plant:
    """The plant from its arrays, its source as it was written; ReadError for anything missing or inconsistent."""
    header = read_header(arrays.get(HEADER), path)
    kind = header["kind"]
    if kind not in KINDS:
        raise ReadError(path, f"holds a {kind}, not a plant ({', '.join(KINDS)})", record=HEADER)
    cls, names = KINDS[kind]
    given = {k: header[k] for k in (*TEXTS, "dt", "report", "source") if k in header}
    matrices = {
        n: arrays[n] if n in arrays else csr_matrix(arrays, n, path) for n in names if n in arrays or f"{n}.indptr" in arrays
    }
    try:
        plant: Plant = cls(**given, **matrices)
    except (ModelError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise ReadError(path, one_line(error)) from None
    return plant


def unpack_matlab(arrays: Arrays, path: Path, texts: Mapping[str, Sequence[str]] = MappingProxyType({})) -> Plant:
    """A plant from plain MATLAB matrices: M, C, K, B, F, G, D (mechss) as Descriptor, A, B, C, D (E) as such.

    A modal plant that `matlab_variables` wrote comes back as one, as long as its A, B, C, D are still those of its modes.
    dt of A, B, C, D: seconds, 0 or none for continuous time. texts: InputName, OutputName, InputUnit, OutputUnit and Name;
    channels without a name are "u1", ..., "y1", ...
    Raises ReadError where the matrices of neither form are there, or do not fit together.
    """
    try:
        if {"M", "K", "B"} <= set(arrays):
            return _from_mechss(arrays, texts)
        if {"A", "B", "C"} <= set(arrays):
            first = _from_first_order(arrays, texts)
            return _modes_of(first, arrays) or first
    except (ModelError, ValueError, TypeError, IndexError) as error:
        raise ReadError(path, one_line(error)) from None
    raise ReadError(path, f"is not a plant: it needs A, B, C, D or M, C, K, B, F, G, D; it has {', '.join(arrays) or 'nothing'}")


def _channels(nu: int, ny: int, texts: Mapping[str, Sequence[str]]) -> dict[str, Any]:
    """Names and units of the channels, and the plant's name, where the file has them."""
    out: dict[str, Any] = {}
    for kind, key, letter, count in (("inputs", "Input", "u", nu), ("outputs", "Output", "y", ny)):
        names, units = (list(texts.get(key + what, ())) for what in ("Name", "Unit"))
        if names and len(names) != count:
            raise ModelError(f"{key}Name has {len(names)} names for {count} {kind}")
        out[kind] = [name or f"{letter}{i + 1}" for i, name in enumerate(names or [""] * count)]
        out |= {f"{kind[:-1]}_units": units} if len(units) == count and any(units) else {}
    return out | ({"name": texts["Name"][0]} if texts.get("Name", [""])[0] else {})


def _from_mechss(arrays: Arrays, texts: Mapping[str, Sequence[str]]) -> Descriptor:
    """x = [q; q']: E = [[I, 0], [0, M]], A = [[0, I], [-K, -C]], B = [0; B], C = [F, G]."""
    M, K, B = (sp.csr_array(arrays[k]) for k in "MKB")
    n, nu = B.shape
    damping = sp.csr_array(arrays["C"]) if "C" in arrays else sp.csr_array((n, n))
    F = sp.csr_array(arrays["F"]) if "F" in arrays else sp.csr_array(np.eye(n))
    G = sp.csr_array(arrays["G"]) if "G" in arrays and np.size(arrays["G"]) else sp.csr_array(F.shape)
    D = arrays["D"] if "D" in arrays and np.size(arrays["D"]) else np.zeros((F.shape[0], nu))
    E = sp.block_diag([sp.eye_array(n), M], format="csr")
    A = sp.block_array([[None, sp.eye_array(n)], [-K, -damping]], format="csr")
    stacked = sp.vstack([sp.csr_array((n, nu)), B])
    return Descriptor(E, A, stacked, sp.hstack([F, G]), D, **_channels(nu, F.shape[0], texts))


def _from_first_order(arrays: Arrays, texts: Mapping[str, Sequence[str]]) -> Plant:
    from flexplant.model.arrays import dense

    A, B, C = (dense(arrays[k]) for k in "ABC")
    D = dense(arrays["D"]) if "D" in arrays else np.zeros((C.shape[0], B.shape[1]))
    channels = _channels(B.shape[1], C.shape[0], texts)
    if "E" in arrays:
        return Descriptor(arrays["E"], A, B, C, D, **channels)
    dt = float(np.ravel(arrays["dt"])[0]) if "dt" in arrays else 0.0
    return StateSpace(A, B, C, D, dt=dt or None, **channels)


def _modes_of(first: Plant, arrays: Arrays) -> ModalPlant | None:
    """The modal plant whose state space this is; None where the file has no modes, or other matrices than theirs."""
    from flexplant.plant.state_space import channels_of, state_space

    if not isinstance(first, StateSpace) or not {"omega", "zeta", "shape_in"} <= set(arrays):
        return None
    given: dict[str, Any] = {n: arrays[n] for n in SHAPES if n in arrays} | channels_of(first)
    plant = ModalPlant(omega=np.ravel(arrays["omega"]), zeta=np.ravel(arrays["zeta"]), **given)
    form = state_space(plant)
    return plant if all(_equal(getattr(form, n), getattr(first, n)) for n in "ABCD") else None


def _equal(ours: FloatArray, stored: FloatArray) -> bool:
    """The same but for the order in which a product was summed, which is another for columns that MATLAB stores."""
    return ours.shape == stored.shape and bool((abs(ours - stored) <= 1e-13 * abs(stored).max(initial=0.0)).all())


def matlab_variables(plant: Plant) -> dict[str, Any]:
    """Variables for a `.mat` file: A, B, C, D (E), dt (0 for continuous time), names as tuples; modal arrays."""
    from flexplant.plant.state_space import state_space

    form = state_space(plant) if isinstance(plant, ModalPlant) else plant
    out: dict[str, Any] = {k: _matlab(getattr(form, k)) for k in ("E", "A", "B", "C", "D") if hasattr(form, k)}
    out["dt"] = float(getattr(form, "dt", None) or 0.0)
    for name, texts in (("InputName", form.inputs), ("OutputName", form.outputs)):
        out[name] = tuple(texts)
    for name, texts in (("InputUnit", form.input_units), ("OutputUnit", form.output_units)):
        out[name] = tuple(texts)
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
