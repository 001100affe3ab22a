"""Characteristic constraint modes: a large boundary described by the few shapes in which it moves slowly."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import scipy.linalg as la

from flexplant.errors import InputError, expect, expect_count
from flexplant.model.arrays import FloatArray, IntArray, dense, is_number
from flexplant.model.component import Component
from flexplant.model.coordinates import LeftOut, in_coordinates
from flexplant.model.dofs import DofSet
from flexplant.numerics.eigen import dense_eigenpairs
from flexplant.reduction.partition import project


def characteristic_constraint_modes(
    component: Component,
    keep: DofSet | Iterable[tuple[int, int | str]],
    *,
    max_frequency_hz: float | None = None,
    n_modes: int | None = None,
) -> Component:
    """Keep the boundary DOF `keep` physical and describe the others, r, by modes of the condensed boundary.

        b_r = -Krr^-1 Krk b_k + Phi_c eta,   Krr Phi_c = Mrr Phi_c diag(w_c^2),   w_c up to max_frequency_hz or the first n

    eta joins the modal coordinates, and all of them are diagonalised again, so that the result is in HCB form with the
    boundary `keep`. It suits boundary DOF that nothing is coupled to one by one. What the modes left out cost is part of
    `estimate_error`, as far as the component came with error rows. Raises ModelError for DOF that are not in the
    boundary, InputError for impossible numbers, SolverError where holding `keep` leaves a massless mechanism.
    Source: Castanier, Tan and Pierre 2001.
    """
    expect(
        component, Component, "characteristic_constraint_modes", "read_component gives one, craig_bampton reduces a model to one"
    )
    if max_frequency_hz is None and n_modes is None:
        raise InputError("characteristic_constraint_modes: give max_frequency_hz or n_modes")
    if max_frequency_hz is not None and not (is_number(max_frequency_hz) and 0 < max_frequency_hz < np.inf):
        raise InputError(
            f"characteristic_constraint_modes: max_frequency_hz must be positive and finite, got {max_frequency_hz!r:.60}"
        )
    if n_modes is not None:
        expect_count(n_modes, "characteristic_constraint_modes: n_modes")
    kept = DofSet.of(keep)
    k_rows = component.boundary.rows(kept.pairs, owner=f"component {component.name!r}")
    r_rows = np.setdiff1d(np.arange(component.n_boundary, dtype=np.int64), k_rows)
    basis, rest = _basis(component, k_rows, r_rows, max_frequency_hz, n_modes)
    basis = _diagonalised(component, basis, k_rows.size)
    omega2, shapes = rest
    lost = LeftOut(
        rows=(shapes / np.sqrt(omega2)).T @ (dense(component.mass)[r_rows] @ basis),
        slowest=float(omega2.min(initial=np.inf)),
        interface=(r_rows.size, basis.shape[1] - k_rows.size - component.n_modal),
    )
    return in_coordinates(component, basis, lost, boundary=kept, nodes=component.nodes)


def _basis(
    component: Component, k_rows: IntArray, r_rows: IntArray, max_frequency_hz: float | None, n_modes: int | None
) -> tuple[FloatArray, tuple[FloatArray, FloatArray]]:
    """T (n, n_k + n_c + n_q): kept DOF with their static shapes, characteristic modes, the old modal coordinates; and w^2 and
    shapes (n_r, k) of the characteristic modes that are left out."""
    stiffness, mass, n_b, n = dense(component.stiffness), dense(component.mass), component.n_boundary, component.n
    krr, mrr = stiffness[np.ix_(r_rows, r_rows)], mass[np.ix_(r_rows, r_rows)]
    found = dense_eigenpairs(krr, mrr, np.zeros((r_rows.size, 0)))
    if n_modes is not None and n_modes > found.omega2.size:
        raise InputError(f"component {component.name!r}: {n_modes} characteristic modes asked, there are {found.omega2.size}")
    limit = np.inf if max_frequency_hz is None else (2 * np.pi * max_frequency_hz) ** 2
    n_c = int(np.count_nonzero(found.omega2[:n_modes] <= limit))
    basis = np.zeros((n, k_rows.size + n_c + n - n_b))
    basis[k_rows, np.arange(k_rows.size)] = 1.0
    basis[r_rows, : k_rows.size] = -la.solve(krr, stiffness[np.ix_(r_rows, k_rows)], assume_a="sym")
    basis[r_rows, k_rows.size : k_rows.size + n_c] = found.vectors[:, :n_c]
    basis[n_b:, k_rows.size + n_c :] = np.eye(n - n_b)
    return basis, (np.maximum(found.omega2[n_c:], np.finfo(float).tiny), found.vectors[:, n_c:])


def _diagonalised(component: Component, basis: FloatArray, n_k: int) -> FloatArray:
    modal = basis[:, n_k:]
    _, rotation = la.eigh(project(component.stiffness, modal), project(component.mass, modal))
    return np.hstack([basis[:, :n_k], modal @ rotation])
