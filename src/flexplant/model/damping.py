"""Component damping from modal ratios (equation 4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np
import scipy.sparse as sp

from flexplant.errors import ModelError, expect
from flexplant.model.arrays import FloatArray, is_number, is_sparse, real_values
from flexplant.model.component import Component

DampingRatio: TypeAlias = float | Sequence[float] | FloatArray | Sequence[tuple[float, float]]


def damping_ratios(ratio: DampingRatio, frequency_hz: FloatArray, what: str = "damping ratio") -> FloatArray:
    """Ratios at the given frequencies, (n,).

    ratio: one value; one value a mode (n,); or a table [(frequency_hz, ratio), ...], linear between its points and
    constant outside. A list of two-element rows is a table. Raises ModelError for negative, NaN or miscounted values.
    """
    given, n = given_ratios(ratio, what), frequency_hz.size
    if given.ndim == 0:
        return np.full(n, float(given))
    if given.ndim == 1 and given.size == n:
        return given.copy()
    if given.ndim == 2 and given.shape[1] == 2 and given.shape[0]:
        order = np.argsort(given[:, 0])
        return np.asarray(np.interp(frequency_hz, given[order, 0], given[order, 1]))
    raise ModelError(f"{what}: give one value, {n} values, or a table of (frequency_hz, ratio) rows; got shape {given.shape}")


def given_ratios(ratio: DampingRatio, what: str = "damping ratio") -> FloatArray:
    """The numbers of a damping ratio, a list or a table, before it is known of how many modes; ModelError for bad ones."""
    given = real_values(ratio, what)
    if given.size and (not np.isfinite(given).all() or given.min() < 0):
        raise ModelError(f"{what}: values must be finite and not negative, got {ratio!r:.60}")
    return given


def with_modal_damping(component: Component, ratio: DampingRatio) -> Component:
    """The component with Z = [[0, 0], [0, 2 xi w]] (equation 4); w from the diagonal of Kqq and Mqq.

    ratio: see `damping_ratios`, one value a modal coordinate. Replaces any viscous damping the component had.
    """
    expect(component, Component, "with_modal_damping", "read_component gives one, craig_bampton reduces a model to one")
    hz = component.fixed_interface_hz
    if np.isnan(hz).any():
        raise ModelError(f"component {component.name!r}: modal coordinates with negative stiffness have no damping ratio")
    xi = damping_ratios(ratio, hz, f"component {component.name!r}: damping ratio")
    modal_mass = component.mass.diagonal()[component.n_boundary :]
    diagonal = np.r_[np.zeros(component.n_boundary), 2 * xi * 2 * np.pi * hz * modal_mass]
    damping = sp.diags_array(diagonal).tocsr() if is_sparse(component.stiffness) else np.diag(diagonal)
    return replace(component, damping=damping)


def with_equivalent_viscous_damping(component: Component, frequency_hz: float) -> Component:
    """The component with its structural damping D turned into viscous damping, Z + D / (2 pi f): the same force at f only.

    Its loss grows with frequency where the structure's is constant: w / (2 pi f) times it. A mode at f has the ratio g / 2 for
    D = g K.
    The component comes back as it is where it has none. Raises ModelError for a frequency that is not positive and finite.
    """
    expect(
        component, Component, "with_equivalent_viscous_damping", "read_component gives one, craig_bampton reduces a model to one"
    )
    if not (is_number(frequency_hz) and 0 < frequency_hz < np.inf):
        raise ModelError(
            f"component {component.name!r}: equivalent damping needs one positive frequency in Hz, got {frequency_hz}"
        )
    if component.structural_damping is None:
        return component
    viscous = component.structural_damping / (2 * np.pi * frequency_hz)
    total = viscous if component.damping is None else component.damping + viscous
    return replace(component, damping=total, structural_damping=None)
