"""Norm and stability of loops on their few channels, against the closed state space, its eigenvalues and its Hamiltonian."""

from __future__ import annotations

import numpy as np
import pytest

import flexplant as fp
from flexplant.errors import DiagramError, InputError
from flexplant.loop import norms
from flexplant.loop.bordered import bordered
from flexplant.loop.close import close
from flexplant.loop.diagram import Diagram
from flexplant.loop.frequency import frequency_response
from flexplant.loop.norms import loop_axes
from flexplant.loop.stability import stability
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import StateSpace
from flexplant.response.norms import hinf_norm as plain_norm

LAG = 1 / (2 * np.pi * 800)


def active(n=10, *, zeta=0.005, rigid=0, rate=1.0, stiffness=0.0, channels=2, kind="shape_out", seed=0) -> Diagram:
    """Collocated feedback -(stiffness + rate s) / (1 + s LAG)^2 on some channels of a plant, the rest driven and read."""
    rng = np.random.default_rng(seed)
    b = rng.normal(size=(n, channels + 2))
    rows = {"shape_out": np.vstack([b[:, :channels].T, rng.normal(size=(2, n))])}
    if kind != "shape_out":
        rows[kind] = np.vstack([np.zeros((channels, n)), rng.normal(size=(2, n))])
    plant = ModalPlant(
        omega=np.r_[np.zeros(rigid), 2 * np.pi * np.sort(rng.uniform(1, 200, n - rigid))],
        zeta=zeta,
        shape_in=b,
        **rows,
        inputs=[*(f"f{k}" for k in range(channels)), "w1", "w2"],
        outputs=[*(f"x{k}" for k in range(channels)), "z1", "z2"],
    )
    A, B = np.array([[0.0, 1.0], [-1 / LAG**2, -2 / LAG]]), np.array([[0.0], [1.0]])
    law = StateSpace(A, B, np.array([[stiffness, rate]]) / LAG**2, np.zeros((1, 1)), ["e"], ["f"])
    minus = fp.gain(-1.0)
    blocks, wires = {"plant": plant}, []
    for k in range(channels):
        blocks |= {f"law{k}": law, f"minus{k}": minus}
        wires += [(f"plant.x{k}", f"law{k}.e"), (f"law{k}.f", f"minus{k}.u"), (f"minus{k}.y", f"plant.f{k}")]
    return Diagram(
        blocks=blocks,
        connections=wires,
        inputs={"w1": "plant.w1", "w2": "plant.w2"},
        outputs={"z1": "plant.z1", "z2": "plant.z2", "force": "minus0.y"},
    )


STABLE = [
    {},
    {"rate": 0.01},
    {"rigid": 2, "stiffness": 100.0},
    {"kind": "shape_out_velocity"},
    {"kind": "shape_out_acceleration", "rigid": 2, "stiffness": 30.0},
    {"zeta": 1.2, "n": 4},
    {"zeta": np.r_[np.full(9, 0.01), 0.0]},
]


@pytest.fixture
def large(monkeypatch):
    """Small diagrams go the way of large ones."""
    monkeypatch.setattr(norms, "SMALL", 0)


@pytest.mark.parametrize("options", STABLE)
def test_bordered_form_is_the_frequency_response(options):
    diagram = active(**options)
    low, high = loop_axes(bordered(diagram))
    hz = np.geomspace(0.3, 5e3, 25)
    omega = 2 * np.pi * hz
    exact = frequency_response(diagram, hz).values
    for axis, t in ((low, omega), (high, 1 / omega)):
        found = axis.responses(t)
        assert (abs(found - exact) <= 1e-9 * abs(exact).max(axis=2, keepdims=True)).all()


@pytest.mark.parametrize("options", STABLE)
def test_curvature_bound_of_a_loop_holds(options):
    low, high = loop_axes(bordered(active(**options)))
    for axis in (low, high):
        rng = np.random.default_rng(0)
        end = axis.points[-1]
        a = np.sort(np.r_[rng.uniform(0, end, 60), axis.points[1:-1] * 1.001])
        length = a * 10 ** rng.uniform(-4, -1.5, a.size)
        bound, _ = axis.curvatures(a, a + length)
        ends = axis.responses(a), axis.responses(a + length)
        known = np.isfinite(bound)
        assert known.any()
        tightest = np.full(a.size, np.inf)
        for fraction in np.linspace(0.1, 0.9, 5):
            inside = axis.responses(a + fraction * length)
            off = np.linalg.norm(inside - (1 - fraction) * ends[0] - fraction * ends[1], axis=(0, 1))
            allowed = 0.5 * fraction * (1 - fraction) * length**2 * bound
            noise = 1e-11 * np.linalg.norm(inside, axis=(0, 1))
            assert (off[known] <= (allowed * (1 + 1e-6) + noise)[known]).all()
            tightest = np.minimum(tightest, allowed / np.maximum(off, noise))
        assert tightest[known].min() < 100


@pytest.mark.parametrize("options", STABLE)
def test_certified_norm_of_a_loop_is_the_hamiltonian_one(large, options):
    diagram = active(**options)
    found, closed = fp.hinf_norm(diagram), plain_norm(close(diagram))
    assert found.value == pytest.approx(closed.value, rel=1e-8)
    assert found.lower <= found.upper <= found.lower * (1 + 1.1e-7)
    assert "stable by winding number" in found.certificate


@pytest.mark.parametrize("seed", range(8))
def test_unstable_poles_are_counted_and_one_is_found(large, seed):
    rng = np.random.default_rng(seed)
    diagram = active(
        seed=seed, rate=float(rng.normal()), stiffness=float(1e3 * rng.normal()), rigid=int(rng.integers(0, 3)), channels=2
    )
    poles = np.linalg.eigvals(close(diagram).A)
    if poles.real.max() < -1e-4:
        assert np.isfinite(fp.hinf_norm(diagram).value)
        return
    known = stability(loop_axes(bordered(diagram)))
    assert known.n_unstable == np.count_nonzero(poles.real > 0)
    assert abs(poles - known.pole).min() < 1e-6 * abs(known.pole)
    found = fp.hinf_norm(diagram)
    assert found.value == np.inf
    assert f"unstable: {known.n_unstable} pole" in found.explanation
    with pytest.raises(InputError, match="infinite: the closed loop is unstable"):
        fp.hinf_norm(diagram, unbounded="error")


def test_unstable_cases_occur_above():
    unstable = [
        np.linalg.eigvals(close(active(seed=s, rate=float(r.normal()), stiffness=float(1e3 * r.normal()))).A).real.max() > 0
        for s in range(8)
        for r in [np.random.default_rng(s)]
    ]
    assert any(unstable)


def test_a_pole_on_the_axis_is_named(large):
    free = fp.hinf_norm(active(rigid=2, rate=1.0, stiffness=0.0))
    assert free.value == np.inf
    assert "on the imaginary axis at 0 Hz" in free.explanation


def test_a_large_loop_and_what_is_not_large():
    found = fp.hinf_norm(active(600, channels=1, kind="shape_out_velocity"))
    assert found.upper <= found.lower * (1 + 1.1e-7)
    assert "unknowns" in found.certificate
    small = fp.hinf_norm(active())
    assert small.certificate == "Hamiltonian test"
    assert fp.hinf_norm(active().blocks["plant"]).certificate.startswith("interval bounds")
    with pytest.raises(InputError, match="tolerance is relative"):
        fp.hinf_norm(active(100), tolerance=2.0)
    nonlinear = Diagram(blocks={"s": fp.saturation(-1.0, 1.0)}, inputs={"u": "s.u"}, outputs={"y": "s.y"})
    with pytest.raises(DiagramError, match="nonlinear"):
        fp.hinf_norm(nonlinear)


def test_the_bound_of_a_series_counts_every_product_of_derivatives():
    """Two equal modes in series: G'' = P'' P + 2 P' P' + P P'', three equal parts at the resonance, all to be covered."""
    one = ModalPlant(omega=[10.0], zeta=1e-3, shape_in=[[1.0]], shape_out=[[1.0]], inputs=["u"], outputs=["y"])
    series = Diagram(
        blocks={"a": one, "b": one}, connections=[("a.y", "b.u")], inputs={"u": "a.u"}, outputs={"y": "b.y"}
    )  # fmt: skip
    axis, _ = loop_axes(bordered(series))
    a, length = np.array([10.0 - 1e-5]), 2e-5
    bound = axis.curvatures(a, a + length)[0]
    values = [axis.responses(a + share * length)[0, 0, 0] for share in (0.0, 0.5, 1.0)]
    exact = abs(values[0] - 2 * values[1] + values[2]) / (length / 2) ** 2
    assert exact <= bound[0] < 1.2 * exact
