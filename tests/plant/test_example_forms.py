"""Plant forms on the example's real components: they agree once the deck's own rigid-body energy is out of the way."""

from __future__ import annotations

import numpy as np
import pytest

import flexplant as fp

HZ = np.array([5.0, 20.0, 60.0, 110.0])
CHANNELS = {"inputs": ["bus.9001.1"], "outputs": ["optic.9101.1"]}


@pytest.fixture(scope="module")
def system():
    folder = fp.example_study("shocksat").parent
    parts = [fp.read_component(folder / f"{name}.OU1", damping=0.005) for name in ("bus", "optic")]
    pairs = [(i, i) for i in range(9201, 9205)]
    return fp.couple(parts, [fp.Connection("bus", "optic", pairs)], method="primal")


def test_modal_against_direct_solution_without_rigid_body_energy(system):
    """The files leave rigid motion some strain energy; the modal plant sets it to zero, so the direct solution must too."""
    basis = system.basis
    k, m, z = (
        (basis.T @ matrix @ basis).toarray()
        for matrix in (system.uncoupled_stiffness, system.uncoupled_mass, system.uncoupled_damping)
    )
    rigid = fp.normal_modes(system).shapes[system.kept][:, :6]
    clean = np.eye(len(k)) - m @ rigid @ rigid.T
    k = clean @ k @ clean.T
    force, motion = (list(system.kept).index(system.row(*dof)) for dof in (("bus", 9001, 1), ("optic", 9101, 1)))
    unit = np.eye(len(k))[force]
    direct = [np.linalg.solve(k - w * w * m + 1j * w * z, unit)[motion] for w in 2 * np.pi * HZ]
    plant = fp.modal_plant(system, **CHANNELS)
    modal = fp.frequency_response(plant, HZ).values[0, 0]
    np.testing.assert_allclose(modal, direct, rtol=1e-9)
    np.testing.assert_allclose(fp.frequency_response(fp.state_space(plant), HZ).values[0, 0], modal, rtol=1e-9)


def test_descriptor_of_the_files_as_they_are(system):
    """With the files' rigid-body energy the difference falls as 1/f^2, and is below 1e-9 where the structure is elastic."""
    modal = fp.frequency_response(fp.modal_plant(system, **CHANNELS), HZ).values[0, 0]
    difference = abs(fp.frequency_response(fp.descriptor(system, **CHANNELS), HZ).values[0, 0] / modal - 1)
    assert difference[1:].max() < 2e-9
    assert difference[0] < 5e-8
