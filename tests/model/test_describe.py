"""What values show at a prompt: headline, names and counts; never matrices."""

import numpy as np
import pytest

import flexplant as fp
from flexplant.model.describe import count, dof_text, listed


@pytest.fixture(scope="module")
def chain():
    folder = fp.example_study("shocksat").parent
    bus, optic = (fp.read_component(folder / f"{name}.OU1") for name in ("bus", "optic"))
    system = fp.couple([bus, optic], [fp.Connection("bus", "optic", "by position", nodes=[9201, 9202, 9203, 9204])])
    plant = fp.modal_plant(system, inputs=["bus.9001.123456"], outputs=["optic.9101.12"], n_modes=20, damping_ratio=0.005)
    sight = fp.LineOfSight(focal_length=1.5, gain=1800, mirror_omega=100, mirror_zeta=0.3)
    loop = fp.line_of_sight_diagram(sight, plant, plant_outputs=plant.outputs)
    return {"bus": bus, "system": system, "plant": plant, "loop": loop}


def test_everything_fits_a_screen_and_says_its_counts(chain):
    system, plant = chain["system"], chain["plant"]
    shown = [
        *chain.values(), fp.normal_modes(system, n_modes=9), fp.state_space(plant), chain["bus"].boundary, chain["bus"].nodes,
        fp.descriptor(system, inputs=["bus.9001.1"], outputs=["bus.9001.1"]),
    ]  # fmt: skip
    for value in shown:
        lines = repr(value).splitlines()
        assert len(lines) <= 7, value
        assert max(map(len, lines)) < 160, value
    assert repr(chain["bus"]).startswith("Component 'bus': 48 boundary DOF, 360 modal")
    assert "9001.123456" in repr(chain["bus"])
    assert repr(system).startswith("System of 2 components, dual: 468 coordinates, 24 constraints, 444 independent")
    assert repr(plant).startswith("ModalPlant 'plant': 20 modes up to")
    assert "6 of them rigid-body" in repr(plant)
    assert "optic.9101.1 [m], optic.9101.2 [m]" in repr(plant)
    assert "plant (ModalPlant)" in repr(chain["loop"])
    assert repr(fp.state_space(plant)).startswith("StateSpace 'plant': 40 states, continuous")


def test_lists_are_cut_and_counted():
    assert listed([]) == "none"
    assert listed(range(20)) == "0, 1, 2, 3, 4, 5, 6, 7 and 12 more"
    assert len(listed(["x" * 60] * 8)) < 90
    assert dof_text([(3, 1), (3, 2), (1, 0)]) == "3.12, 1.0"
    assert [count(1, "mode"), count(2, "mode"), count(3, "DOF", "DOF")] == ["1 mode", "2 modes", "3 DOF"]


def test_plants_without_modes_or_channels_show_too():
    empty = fp.ModalPlant(omega=[], zeta=[], shape_in=np.zeros((0, 0)), inputs=[], outputs=[])
    assert repr(empty).splitlines()[0] == "ModalPlant 'plant': 0 modes"
