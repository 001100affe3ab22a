"""Print every number that README.md states about the stored data (numpy and scipy only).

Usage: ``python check.py``
"""

from __future__ import annotations

from pathlib import Path

import matrices
import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from generate import BOUNDARY, FEET, INCH
from mystran_files import read_grids, read_op4
from scipy.sparse.linalg import LinearOperator, eigsh, splu

DATA = Path(__file__).parent / "data"
SHIFT = -((2 * np.pi * 30.0) ** 2)  # below zero: K - SHIFT M is positive definite although K is singular


def hertz(eigenvalue: np.ndarray) -> np.ndarray:
    """Frequency in Hz, negative for a negative eigenvalue."""
    return np.sign(eigenvalue) * np.sqrt(abs(eigenvalue)) / (2 * np.pi)


def free_modes(model: matrices.Matrices, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies in Hz and mass-normalised shapes (columns) of the lowest free-free modes."""
    shifted = sp.csc_array(model.stiffness - SHIFT * model.mass)
    factor = splu(shifted, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    inverse = LinearOperator(shifted.shape, factor.solve)
    start = np.random.default_rng(1).standard_normal(shifted.shape[0])
    value, shape = eigsh(model.stiffness, count, model.mass, sigma=SHIFT, OPinv=inverse, v0=start)
    return hertz(value), shape


def print_difference(title: str, frequency: np.ndarray, reference: np.ndarray, below_hz: float) -> None:
    """The worst relative difference of the flexible modes below a frequency."""
    flexible = reference[6 : np.searchsorted(reference, below_hz)]
    difference = abs(frequency[6 : 6 + len(flexible)] / flexible - 1)
    place = difference.argmax()
    print(f"{title}: {len(flexible)} flexible modes below {below_hz:.0f} Hz, worst relative difference", end=" ")
    print(f"{difference[place]:.1e} at {flexible[place]:.2f} Hz")


def print_energies(model: matrices.Matrices, frequency: np.ndarray, shape: np.ndarray) -> None:
    """Kinetic energy of the first flexible modes by direction."""
    print("mode   frequency Hz   kinetic energy x / y / z / rotations, %")
    for mode in range(6, 10):
        energy = shape[:, mode] * (model.mass @ shape[:, mode])
        share = [energy[model.dof[:, 1] == direction].sum() for direction in (1, 2, 3)]
        share.append(energy.sum() - sum(share))
        percent = " / ".join(f"{100 * s / energy.sum():5.1f}" for s in share)
        print(f"{mode - 5:4d} {frequency[mode]:14.4f}   {percent}")


def print_mass_properties(model: matrices.Matrices) -> None:
    """Mass and centre of gravity, from the rigid-body mass about the origin."""
    grids = read_grids(DATA / "whole.bdf")
    links = [matrices.rigid_link(grids[grid])[direction - 1] for grid, direction in model.dof]
    rigid = np.array(links).T @ (model.mass @ np.array(links))
    mass, (x, y, z) = rigid[0, 0], (rigid[1, 5], rigid[2, 3], rigid[0, 4]) / rigid[0, 0]
    print(f"mass {mass:.4f} kg, centre of gravity {x:.1e}, {y:.1e}, {z:.6f} m (z = {z / INCH:.3f} in)")
    stiffness = abs(model.stiffness @ np.array(links)).max() / abs(model.stiffness).max()
    print(f"whole: rigid-body force / largest stiffness {stiffness:.1e}")


def coupled() -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """K and M of bus and optic, coupled at the four feet by sharing their DOF (primal); each one's places in them."""
    components = {name: read_op4(DATA / f"{name}.OU1") for name in BOUNDARY}
    index = {name: [6 * grids.index(foot) + d for foot in FEET for d in range(6)] for name, grids in BOUNDARY.items()}
    bus, optic = (len(components[name]["KXX"]) for name in ("bus", "optic"))
    place = np.zeros(optic, int)
    others = np.setdiff1d(np.arange(optic), index["optic"])
    place[index["optic"]], place[others] = index["bus"], bus + np.arange(len(others))
    k, m = np.zeros((2, bus + len(others), bus + len(others)))
    for whole, key in ((k, "KXX"), (m, "MXX")):
        whole[:bus, :bus] = components["bus"][key]
        whole[np.ix_(place, place)] += components["optic"][key]
    return (k + k.T) / 2, (m + m.T) / 2, {"bus": np.arange(bus), "optic": place}


def print_coupling(reference: np.ndarray) -> None:
    k, m, places = coupled()
    value, vectors = la.eigh(k, m)
    frequency = hertz(value)
    print("coupled components, rigid-body modes, Hz:", np.round(frequency[:6], 6))
    for mode in range(6, 10):
        error = 100 * (frequency[mode] / reference[mode] - 1)
        print(f"{mode - 5:4d} {frequency[mode]:12.4f} Hz, whole {reference[mode]:10.4f} Hz, error {error:.4f} %")
    for below_hz in (200.0, 300.0, 500.0):
        print_difference("coupled components against MYSTRAN whole", frequency, reference, below_hz)
    flexible = slice(6, np.searchsorted(reference, 500.0))
    lowest = (frequency[flexible] / reference[flexible] - 1).min()
    print(f"coupled components against MYSTRAN whole: lowest signed relative difference below 500 Hz {lowest:.1e}")
    for name, place in places.items():
        print_display_mac(name, vectors[place])


def print_display_mac(name: str, vectors: np.ndarray) -> None:
    """The coupled modes as the display matrix shows them, against MYSTRAN's shapes of the whole."""
    with np.load(DATA / f"{name}_display.npz") as display, np.load(DATA / "mystran_modes.npz") as modes:
        shown = display["matrix"] @ vectors[:, 6:16]
        places = np.searchsorted(modes["nodes"], display["nodes"])
        expected = modes["shapes"][6:16, places].reshape(10, -1).T
    mac = (shown * expected).sum(0) ** 2 / ((shown**2).sum(0) * (expected**2).sum(0))
    print(f"{name}: display matrix against MYSTRAN whole, lowest MAC of flexible modes 1-10 {mac.min():.6f}")


def print_component(name: str) -> None:
    """Fixed-interface frequencies, and how far the boundary and display rows are from moving rigidly."""
    matrix, grids = read_op4(DATA / f"{name}.OU1")["KXX"], read_grids(DATA / f"{name}.bdf")
    boundary = 6 * len(BOUNDARY[name])
    rigid = np.vstack([matrices.rigid_link(grids[grid]) for grid in BOUNDARY[name]])
    force = abs(matrix[:boundary, :boundary] @ rigid).max() / abs(matrix[:boundary, :boundary]).max()
    fixed = hertz(np.diag(matrix)[boundary:])
    print(f"{name}: {boundary} + {len(fixed)} coordinates", end=", ")
    print(f"fixed-interface modes {fixed.min():.3f} to {fixed.max():.2f} Hz")
    print(f"{name}: rigid-body force / largest boundary stiffness {force:.1e}")
    with np.load(DATA / f"{name}_display.npz") as display:
        expected = np.vstack([matrices.rigid_link(position)[:3] for position in display["positions"]])
        error = abs(display["matrix"][:, :boundary] @ rigid - expected).max()
        print(f"{name}: display set of {len(display['nodes'])} grids, rigid-body error {error:.1e}")


def main() -> None:
    model = matrices.load(DATA / "whole_KM.npz")
    with np.load(DATA / "mystran_modes.npz") as data:
        reference = data["frequency_hz"]
    frequency, shape = free_modes(model, 140)
    print("whole, rigid-body modes, Hz: MYSTRAN", np.round(reference[:6], 6), "scipy", np.round(frequency[:6], 6))
    for below_hz in (300.0, 500.0):
        print_difference("whole, scipy against MYSTRAN", frequency, reference, below_hz)
    print_energies(model, frequency, shape)
    print_mass_properties(model)
    for name in BOUNDARY:
        print_component(name)
    print_coupling(reference)


if __name__ == "__main__":
    main()
