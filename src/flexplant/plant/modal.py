"""The modal plant: mass-normalised modes with named inputs and outputs; the form everything fast runs on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from flexplant.errors import ModelError
from flexplant.model.arrays import FloatArray
from flexplant.plant.fields import checked_dense, checked_names, checked_units, checked_vector


@dataclass(frozen=True, eq=False, kw_only=True)
class ModalPlant:
    """A structure in mass-normalised modal coordinates (E = I).

        eta'' + Z eta' + omega^2 eta = shape_in u
        y = shape_out eta + shape_out_velocity eta' + shape_out_acceleration eta'' + (feedthrough + static_correction) u

    omega: (n,) rad/s, exactly 0 for a rigid-body mode. zeta: (n,) damping ratios, or one value for all modes.
    shape_in: (n, nu) modal forces of unit inputs. shape_out, shape_out_velocity, shape_out_acceleration: (ny, n) or None.
    damping: (n, n) full symmetric Z, or None for diag(2 zeta omega). static_correction, feedthrough: (ny, nu) or None.
    inputs, outputs: distinct names; input_units, output_units: one text a channel. report: what was truncated or dropped.
    Raises ModelError with the names and shapes that disagree.
    """

    omega: FloatArray
    zeta: FloatArray
    shape_in: FloatArray
    shape_out: FloatArray | None = None
    inputs: Sequence[str]
    outputs: Sequence[str]
    shape_out_velocity: FloatArray | None = None
    shape_out_acceleration: FloatArray | None = None
    damping: FloatArray | None = None
    static_correction: FloatArray | None = None
    feedthrough: FloatArray | None = None
    name: str = "plant"
    input_units: Sequence[str] = ()
    output_units: Sequence[str] = ()
    report: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        owner = f"modal plant {self.name!r}"
        self._set("omega", checked_vector(self.omega, None, f"{owner}: omega"))
        zeta = np.full(self.n_modes, float(self.zeta)) if np.ndim(self.zeta) == 0 else self.zeta
        self._set("zeta", checked_vector(zeta, self.n_modes, f"{owner}: zeta"))
        for kind in ("inputs", "outputs"):
            names = checked_names(getattr(self, kind), kind, owner)
            self._set(kind, names)
            units = f"{kind[:-1]}_units"
            self._set(units, checked_units(getattr(self, units), len(names), units, owner))
        self._check_shapes(owner)
        if self.damping is not None and not np.allclose(
            self.damping, self.damping.T, rtol=1e-6, atol=1e-6 * abs(self.damping).max()
        ):
            raise ModelError(f"{owner}: damping matrix is not symmetric")

    def _set(self, name: str, value: Any) -> None:
        object.__setattr__(self, name, value)

    def _check_shapes(self, owner: str) -> None:
        n, nu, ny = self.n_modes, len(self.inputs), len(self.outputs)
        shapes = {
            "shape_in": (n, nu),
            "shape_out": (ny, n),
            "shape_out_velocity": (ny, n),
            "shape_out_acceleration": (ny, n),
            "damping": (n, n),
            "static_correction": (ny, nu),
            "feedthrough": (ny, nu),
        }
        if self.shape_out is None:
            self._set("shape_out", np.zeros((ny, n)))
        for kind, shape in shapes.items():
            if (matrix := getattr(self, kind)) is not None:
                what = f"{owner} ({n} modes, {nu} inputs, {ny} outputs): {kind}"
                self._set(kind, checked_dense(matrix, shape, what))

    @property
    def n_modes(self) -> int:
        """Number of modes."""
        return int(self.omega.size)

    @property
    def n_rigid(self) -> int:
        """Number of rigid-body modes (omega exactly 0)."""
        return int(np.count_nonzero(self.omega == 0.0))

    @property
    def frequency_hz(self) -> FloatArray:
        """(n,) undamped frequencies, Hz."""
        return self.omega / (2 * np.pi)

    @property
    def damping_matrix(self) -> FloatArray:
        """(n, n) modal damping Z, 1/s."""
        return np.diag(2 * self.zeta * self.omega) if self.damping is None else self.damping

    @property
    def direct(self) -> FloatArray:
        """(ny, nu) feedthrough + static_correction: the part of y proportional to u, beside that through eta''."""
        parts = [p for p in (self.feedthrough, self.static_correction) if p is not None]
        return np.sum(parts, axis=0) if parts else np.zeros((len(self.outputs), len(self.inputs)))
