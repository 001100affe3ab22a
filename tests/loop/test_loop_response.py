"""Loops broken at named signals: curves by their definitions, margins against eigenvalue pencils and the closed loop."""

from __future__ import annotations

import numpy as np
import pytest

import flexplant as fp
from flexplant.blocks.transfer_function import transfer_function
from flexplant.errors import DiagramError, InputError
from flexplant.loop import margins as routed
from flexplant.loop import norms
from flexplant.loop.breaking import cut_open, disturbed
from flexplant.loop.close import close
from flexplant.loop.diagram import Diagram
from flexplant.loop.loop_peaks import sensitivity_peaks
from flexplant.loop.loop_response import loop_margins, loop_response
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import StateSpace
from flexplant.response.crossings import crossings, refined_grid
from flexplant.response.margins import margins as by_pencils
from flexplant.response.norms import hinf_norm as plain_norm


def two_axes(n=12, *, rigid=0, zeta=0.005, rate=30.0, stiffness=0.0, seed=0, out="shape_out") -> Diagram:
    """A plant with two collocated rate loops and a disturbance that no loop needs."""
    rng = np.random.default_rng(seed)
    b = rng.normal(size=(n, 3))
    plant = ModalPlant(
        omega=np.r_[np.zeros(rigid), 2 * np.pi * np.sort(rng.uniform(1, 200, n - rigid))],
        zeta=zeta,
        shape_in=b,
        **{out: b.T},
        inputs=["f0", "f1", "w"],
        outputs=["x0", "x1", "z"],
    )
    law = transfer_function([-rate, -stiffness], [1e-7, 6e-4, 1.0], input_name="e", output_name="f")
    wires = [(f"plant.x{k}", f"law{k}.e") for k in (0, 1)] + [(f"law{k}.f", f"plant.f{k}") for k in (0, 1)]
    blocks = {"plant": plant, "law0": law, "law1": law}
    return Diagram(blocks=blocks, connections=wires, inputs={"w": "plant.w"}, outputs={"z": "plant.z"})


AT = ["plant.x0", "plant.x1"]


def loop_gain_of(diagram: Diagram, at: list[str]) -> StateSpace:
    s = close(cut_open(diagram, at))
    return StateSpace(s.A, s.B, -s.C, -s.D, s.inputs, s.outputs, dt=s.dt)


def test_curves_obey_their_definitions():
    diagram, hz = two_axes(), np.geomspace(0.5, 500, 60)
    found = loop_response(diagram, AT, hz)
    L = fp.frequency_response(loop_gain_of(diagram, AT), hz).values
    assert np.allclose(found.L, L, rtol=1e-9, atol=1e-12)
    for k in range(hz.size):
        S = np.linalg.inv(np.eye(2) + L[:, :, k])
        assert np.allclose(found.S[:, :, k], S, atol=1e-9)
        assert np.allclose(found.T[:, :, k], L[:, :, k] @ S, atol=1e-9)
        assert np.allclose(found.S_singular[k], np.linalg.svd(S, compute_uv=False), rtol=1e-8)
        half = 0.5 * (found.S[:, :, k] - found.T[:, :, k])
        assert found.disk[k] == pytest.approx(1 / np.linalg.norm(half, 2), rel=1e-9)
        # loop 0 alone, loop 1 closed
        value = L[0, 0, k] - L[0, 1, k] * L[1, 0, k] / (1 + L[1, 1, k])
        assert found.loop[0, k].item() == pytest.approx(value, rel=1e-8)
    assert found.disk_margin <= found.disk.min() * (1 + 1e-6)
    assert found.S_peak >= found.S_singular.max() * (1 - 1e-6)
    assert list(found.signal.values) == AT
    assert found.attrs["grid"] == "given"
    own = loop_response(diagram, AT)
    assert own.attrs["grid"].startswith(f"{own.sizes['frequency']} points about the poles of every block")
    assert own.S_singular.max() <= own.S_peak * (1 + 1e-12)


@pytest.mark.parametrize(
    "options",
    [{}, {"rigid": 2, "stiffness": 300.0}, {"rate": -0.5}, {"out": "shape_out_velocity", "rate": 0.0, "stiffness": 20.0}],
)
@pytest.mark.parametrize("at", [AT, AT[:1], ["law1.f"]])
def test_margins_are_those_of_the_pencils(options, at):
    diagram = two_axes(**options)
    found, exact = loop_margins(diagram, at), by_pencils(loop_gain_of(diagram, at))
    assert found.stable == exact.stable
    for ours, theirs in zip(found.loops, exact.loops, strict=True):
        assert ours.gain_crossings_hz == pytest.approx(theirs.gain_crossings_hz, rel=1e-8)
        assert ours.phase_margins_deg == pytest.approx(theirs.phase_margins_deg, abs=1e-5)
        assert ours.phase_crossings_hz == pytest.approx(theirs.phase_crossings_hz, rel=1e-8)
        assert ours.gain_margins_db == pytest.approx(theirs.gain_margins_db, abs=1e-5)
        assert ours.delay_margin_s == pytest.approx(theirs.delay_margin_s, rel=1e-6)
    assert found.disk.alpha == pytest.approx(exact.disk.alpha, rel=1e-6)
    assert found.sensitivity_peak.value == pytest.approx(exact.sensitivity_peak.value, rel=1e-6)
    assert found.complementary_peak.value == pytest.approx(exact.complementary_peak.value, rel=1e-6)


@pytest.mark.parametrize("options", [{}, {"rigid": 2, "stiffness": 300.0}, {"out": "shape_out_velocity", "stiffness": 20.0}])
@pytest.mark.parametrize("at", [AT, AT[:1], ["law1.f"]])
@pytest.mark.parametrize("seen", [[], [3.0, 40.0]])
def test_one_search_finds_the_three_norms(monkeypatch, options, at, seen):
    """S, T and (S - T) / 2 together, certified, against the Hamiltonian norm of each closed diagram by itself."""
    diagram = two_axes(**options)
    one_by_one = {kind: plain_norm(close(system)) for kind, system in disturbed(diagram, at).items()}
    monkeypatch.setattr(norms, "SMALL", 0)
    found = sensitivity_peaks(disturbed(diagram, at).__getitem__, np.array(seen))
    assert set(found) == set(one_by_one)
    for kind, peak in found.items():
        assert peak.value == pytest.approx(one_by_one[kind].value, rel=1e-7)
        assert peak.lower <= peak.upper <= peak.lower * (1 + 1.1e-7)
        assert "stable by winding number" in peak.certificate


def test_the_peak_of_a_small_loop_gain_keeps_its_digits(monkeypatch):
    """T of a loop gain of 1e-9 is not what is left of 1 - S."""
    diagram, at = two_axes(rate=1e-8), ["plant.x0"]
    exact = plain_norm(close(disturbed(diagram, at)["T"])).value
    monkeypatch.setattr(norms, "SMALL", 0)
    assert exact < 1e-6
    assert sensitivity_peaks(disturbed(diagram, at).__getitem__, np.zeros(0))["T"].value == pytest.approx(exact, rel=1e-7)


def test_margins_do_not_depend_on_the_grid():
    coarse, fine = (loop_response(two_axes(), AT, hz) for hz in ([1.0, 2.0], np.geomspace(0.1, 1e3, 500)))
    for name in ("phase_margin_deg", "gain_margin_db", "disk_margin", "S_peak", "delay_margin_s"):
        assert np.array_equal(coarse[name], fine[name])


def test_the_disk_is_safe_and_its_edge_is_not():
    """Gains and phases inside the disk keep the closed loop stable; the smallest factor on its edge moves a pole to the axis."""
    diagram = two_axes(rigid=2, stiffness=300.0)
    disk = loop_margins(diagram, AT).disk
    L = loop_gain_of(diagram, AT)

    def most_right(factors) -> float:
        return float(np.linalg.eigvals(L.A - L.B * factors @ L.C).real.max())

    rng = np.random.default_rng(0)
    for _ in range(40):
        assert most_right(rng.uniform(disk.gain_low, disk.gain_high, 2)) < 0
    # the worst complex factor per channel, built from the singular vectors at the peak: det(I + L F) = 0 there
    value = fp.frequency_response(L, [disk.frequency_hz]).values[:, :, 0]
    S = np.linalg.inv(np.eye(2) + value)
    u, s, vh = np.linalg.svd(S - 0.5 * np.eye(2))
    assert 1 / s[0] == pytest.approx(disk.alpha, rel=1e-6)
    delta = -np.outer(vh[0].conj(), u[:, 0].conj()) / s[0]
    factor = np.linalg.solve(np.eye(2) + 0.5 * delta, np.eye(2) - 0.5 * delta)
    inverse = np.linalg.solve(np.eye(2) - 0.5 * delta, np.eye(2) + 0.5 * delta)
    determinants = [abs(np.linalg.det(np.eye(2) + value @ f)) for f in (factor, inverse)]
    assert min(determinants) < 1e-6 * abs(np.linalg.det(np.eye(2) + value))


def test_large_loop_gains_take_the_other_way(monkeypatch):
    rng = np.random.default_rng(1)
    b = rng.normal(size=(20, 2))
    plant = ModalPlant(
        omega=2 * np.pi * np.sort(rng.uniform(1, 50, 20)),
        zeta=0.02,
        shape_in=b,
        shape_out_velocity=3 * b.T,
        inputs=["u", "v"],
        outputs=["x", "y"],
    )
    small = fp.margins(plant)
    monkeypatch.setattr(routed, "LARGE", 0)
    large = fp.margins(plant)
    assert [loop.channel for loop in large.loops] == ["x", "y"]
    for ours, theirs in zip(large.loops, small.loops, strict=True):
        assert ours.gain_crossings_hz == pytest.approx(theirs.gain_crossings_hz, rel=1e-8)
        assert ours.phase_margin_deg == pytest.approx(theirs.phase_margin_deg, abs=1e-6)
    assert large.disk.alpha == pytest.approx(small.disk.alpha, rel=1e-6)
    with pytest.raises(InputError, match="loop_margins"):
        fp.margins(two_axes())


def test_discrete_loops():
    continuous = loop_gain_of(two_axes(4), AT)
    discrete = fp.discretize(continuous, 2e-4)
    blocks = {"L": discrete, "minus": fp.gain([-1.0, -1.0])}
    wires = [(f"L.{y}", f"minus.u{k + 1}") for k, y in enumerate(discrete.outputs)]
    wires += [(f"minus.y{k + 1}", f"L.{u}") for k, u in enumerate(discrete.inputs)]
    diagram = Diagram(blocks=blocks, connections=wires)
    found, exact = loop_margins(diagram, [f"L.{y}" for y in discrete.outputs]), by_pencils(discrete)
    for ours, theirs in zip(found.loops, exact.loops, strict=True):
        assert ours.gain_crossings_hz == pytest.approx(theirs.gain_crossings_hz, rel=1e-7)
        assert ours.phase_margin_deg == pytest.approx(theirs.phase_margin_deg, abs=1e-5)


def test_an_unstable_loop_says_so():
    diagram = two_axes(rate=30.0, rigid=2, stiffness=-3e3)
    found = loop_response(diagram, AT, [1.0, 2.0])
    assert not found.stable
    assert found.disk_margin == 0
    assert "unstable" in found.attrs["explanation"]
    assert set(disturbed(diagram, AT)) == {"S", "T", "half"}


@pytest.mark.parametrize(
    ("at", "error", "message"),
    [
        ("plant.x9", DiagramError, "Did you mean 'plant.x"),
        ("plant", DiagramError, "write 'block.port'"),
        ("planet.x0", DiagramError, "Did you mean 'plant'"),
        ([], InputError, "name one or several"),
        (["plant.x0", "plant.x0"], InputError, "different signals"),
        ("plant.z", InputError, "drives no block"),
        (3, InputError, "name one or several"),
    ],
)
def test_signals_that_cannot_be_broken(at, error, message):
    with pytest.raises(error, match=message):
        loop_response(two_axes(), at)


def test_other_bad_requests():
    with pytest.raises(InputError, match="broken in a Diagram, got StateSpace"):
        loop_margins(loop_gain_of(two_axes(), AT), AT)
    with pytest.raises(InputError, match="frequencies must be finite and not negative"):
        loop_response(two_axes(), AT, [-1.0])
    undamped = two_axes(zeta=0.0)
    hz = undamped.blocks["plant"].frequency_hz[3]
    with pytest.raises(InputError, match="on mode 3"):
        loop_response(undamped, AT, [hz])


def test_a_pole_between_two_points_is_no_crossing():
    """L = -1 + i / (f - 1) changes the sign of its imaginary part at its pole, and nowhere reaches the real axis."""

    def loops(hz):
        return (-1 + 1j / (hz - 1))[None, :]

    grid, values = refined_grid(loops, np.linspace(0.55, 2.0, 40))
    assert crossings(loops, grid, values)[0].phase_hz.size == 0
    assert crossings(lambda hz: 2 / hz[None, :] + 0j, grid, 2 / grid[None, :] + 0j)[0].unit_hz == pytest.approx([2.0])


def test_crossings_are_exact_to_round_off_in_few_evaluations():
    """A loop of known crossings: |L| = 1 where sin = 0, and Im L = 0 with Re L < 0 where cos = 0 and falls."""
    calls = []

    def loops(hz):
        calls.append(hz.size)
        x = 40 * np.log(hz)
        size = np.exp(np.sin(x) + np.sin(x) ** 3)
        return np.stack([size * np.exp(1j * (np.pi + 0.7)) + 0 * hz, -np.sin(x) + 1j * np.cos(x) ** 3])

    hz = np.geomspace(1.0, 3.0, 300)
    found = crossings(loops, hz, loops(hz))
    unit = np.exp(np.arange(1, int(40 * np.log(3.0) / np.pi) + 1) * np.pi / 40)
    assert found[0].unit_hz == pytest.approx(unit, rel=5e-15)
    assert abs(found[0].at_unit) == pytest.approx(1.0, abs=1e-12)
    assert found[0].phase_hz.size == 0
    # a root of order three is flat: its last digits are those of the cube root of the smallest numbers
    phase = np.exp((0.5 + 2 * np.arange(7)) * np.pi / 40)
    assert found[1].phase_hz == pytest.approx(phase[phase < 3.0], rel=1e-7)
    assert len(calls) < 110
    calls.clear()
    crossings(lambda hz: loops(hz)[:1], hz, loops(hz)[:1])
    assert len(calls) < 16
