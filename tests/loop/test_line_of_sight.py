"""The published loop: its curves from the diagram, from formulas, and from python-control."""

import control
import numpy as np
import pytest

from flexplant.errors import InputError
from flexplant.loop.close import close
from flexplant.loop.figures_of_merit import loop_figures
from flexplant.loop.frequency import frequency_response
from flexplant.loop.line_of_sight import LineOfSight, closed_loop_transfer, line_of_sight_diagram, loop_gain, output_sensitivity
from flexplant.response.frequency import frequency_response as plant_response

HZ = np.geomspace(0.1, 1e4, 80)
S = 2j * np.pi * HZ
KP, OMEGA, ZETA = 1800.0, 100.0, 0.3
L = KP * OMEGA**2 / (S**2 + 2 * ZETA * OMEGA * S + OMEGA**2)


def test_published_figures(published):
    for axis in loop_figures(published):
        assert axis.peak_hz == pytest.approx(675.4, rel=1e-3)
        assert axis.bandwidth_hz == pytest.approx(1049.4, rel=1e-3)
        assert axis.rejection_hz == pytest.approx(434.8, rel=1e-3)
        assert axis.phase_margin_deg == pytest.approx(0.81, abs=5e-3)


def test_figures_are_those_of_each_axis(published):
    """Two unequal axes, against each alone."""
    both = loop_figures(LineOfSight(focal_length=1.5, gain=[1800.0, 50.0], mirror_omega=[100.0, 40.0], mirror_zeta=[0.3, 0.6]))
    alone = loop_figures(LineOfSight(focal_length=1.5, gain=50.0, mirror_omega=40.0, mirror_zeta=0.6))[1]
    assert both[0].peak_hz == pytest.approx(loop_figures(published)[0].peak_hz)
    assert both[1] == alone


def test_figures_against_closed_form(published):
    """In x = (w / wF)^2 all four are roots of quadratics."""
    axis = loop_figures(published)[0]
    hz, c = OMEGA / (2 * np.pi), 4 * ZETA**2
    peak = 1 + KP - c / 2
    assert axis.peak_hz == pytest.approx(hz * np.sqrt(peak), rel=1e-7)
    assert axis.peak == pytest.approx(KP / np.sqrt((1 + KP - peak) ** 2 + c * peak), rel=1e-9)
    # |Kp / (1 + Kp - x + i sqrt(c x))|^2 = 1/2
    bandwidth = np.roots([1, c - 2 * (1 + KP), (1 + KP) ** 2 - 2 * KP**2]).max()
    assert axis.bandwidth_hz == pytest.approx(hz * np.sqrt(bandwidth), rel=1e-9)
    # |(1 - x + i sqrt(c x)) / (1 + Kp - x + i sqrt(c x))|^2 = 1/2
    rejection = np.roots([1, c - 4 + 2 * (1 + KP), 2 - (1 + KP) ** 2]).max()
    assert axis.rejection_hz == pytest.approx(hz * np.sqrt(rejection), rel=1e-9)
    crossover = np.roots([1, c - 2, 1 - KP**2]).max()
    assert axis.crossover_hz == pytest.approx(hz * np.sqrt(crossover), rel=1e-9)
    margin = np.degrees(np.arctan2(np.sqrt(c * crossover), crossover - 1))
    assert axis.phase_margin_deg == pytest.approx(margin, rel=1e-7)


def test_phase_margin_agrees_with_python_control(published):
    _, margin, _, crossover = control.margin(control.tf([KP * OMEGA**2], [1, 2 * ZETA * OMEGA, OMEGA**2]))
    axis = loop_figures(published)[1]
    assert axis.phase_margin_deg == pytest.approx(margin, rel=1e-6)
    assert axis.crossover_hz == pytest.approx(crossover / (2 * np.pi), rel=1e-6)


@pytest.mark.parametrize(
    ("build", "formula"), [(loop_gain, L), (closed_loop_transfer, L / (1 + L)), (output_sensitivity, 1 / (1 + L))]
)
def test_loop_curves_are_their_formulas(published, build, formula):
    G = plant_response(build(published), HZ).values
    for k in range(2):
        assert G[k, k] == pytest.approx(formula, rel=1e-9, abs=0)
    assert not G[0, 1].any()
    assert not G[1, 0].any()


def test_sensitivity_and_closed_loop_add_to_one(published):
    S_plus_T = (
        plant_response(output_sensitivity(published), HZ).values + plant_response(closed_loop_transfer(published), HZ).values
    )
    for k in range(2):
        assert S_plus_T[k, k] == pytest.approx(np.ones(HZ.size), rel=1e-9)


def test_closed_loop_is_the_open_plant_times_the_sensitivity(published, plant):
    """The disturbance enters at the output: spot = S(s) dx, for each axis with its own gain."""
    los = LineOfSight(focal_length=1.5, gain=[1800.0, 400.0], mirror_omega=[100.0, 80.0], mirror_zeta=[0.3, 0.6])
    closed = frequency_response(line_of_sight_diagram(los, plant), HZ).values
    opened = frequency_response(line_of_sight_diagram(los, plant, closed=False), HZ).values
    assert np.allclose(opened, plant_response(plant, HZ).values, rtol=1e-12, atol=0)
    for k in range(2):
        w, z = los.mirror_omega[k], los.mirror_zeta[k]
        loop = los.gain[k] * w**2 / (S**2 + 2 * z * w * S + w**2)
        assert np.allclose(closed[k], opened[k] / (1 + loop), rtol=1e-9, atol=0)


def test_the_focal_length_cancels_in_the_loop(plant):
    """The gain multiplies the equivalent angle r / (2 f), so the loop gain is Kp T(s) whatever f."""
    responses = [
        frequency_response(
            line_of_sight_diagram(LineOfSight(focal_length=f, gain=KP, mirror_omega=OMEGA, mirror_zeta=ZETA), plant), HZ
        ).values
        for f in (0.5, 1.5)
    ]
    assert np.allclose(*responses, rtol=1e-9, atol=0)


def test_command_moves_the_spot(published):
    """A commanded mirror angle a moves the spot by 2 f a T_cl."""
    diagram = line_of_sight_diagram(published, commands=True)
    response = frequency_response(diagram, HZ).sel(output="spot_x", input="command_x").values
    assert response == pytest.approx(2 * 1.5 * L / (1 + L), rel=1e-9, abs=0)


def test_closed_loop_poles(published):
    poles = np.sort_complex(np.linalg.eigvals(close(line_of_sight_diagram(published)).A))
    pair = -ZETA * OMEGA + 1j * OMEGA * np.sqrt(1 + KP - ZETA**2)
    assert poles == pytest.approx(np.sort_complex([pair, pair, pair.conjugate(), pair.conjugate()]), rel=1e-7)


def test_errors(published, plant):
    with pytest.raises(InputError, match="plant_outputs"):
        line_of_sight_diagram(published, plant, plant_outputs=["optic.1.1"])
    with pytest.raises(InputError, match=r"no signal 'spots'.*'spot'"):
        line_of_sight_diagram(published, signals=["spots"])
    with pytest.raises(InputError, match="mirror_omega"):
        LineOfSight(focal_length=1.5, gain=1.0, mirror_omega=[1, 2, 3], mirror_zeta=0.3)
    for bad in ("1.5", None, 1j, [1.5, 1.5]):
        with pytest.raises(InputError, match="focal length"):
            LineOfSight(focal_length=bad, gain=1.0, mirror_omega=100.0, mirror_zeta=0.3)
    with pytest.raises(InputError, match="gain: real numbers"):
        LineOfSight(focal_length=1.5, gain="high", mirror_omega=100.0, mirror_zeta=0.3)
    with pytest.raises(InputError, match="axes must be a list"):
        LineOfSight(focal_length=1.5, gain=1.0, mirror_omega=100.0, mirror_zeta=0.3, axes=2)
    with pytest.raises(InputError, match="never reaches one"):
        loop_figures(LineOfSight(focal_length=1.5, gain=0.5, mirror_omega=100.0, mirror_zeta=0.8))


def test_a_weak_loop_has_no_rejection():
    """Kp = 0.3 crosses one at the mirror's resonance, but statically 1 / (1 + Kp) stays above half power."""
    weak = loop_figures(LineOfSight(focal_length=1.5, gain=0.3, mirror_omega=100.0, mirror_zeta=0.05))[0]
    assert weak.crossover_hz > 100 / (2 * np.pi)
    assert np.isfinite(weak.bandwidth_hz)
    assert np.isnan(weak.rejection_hz)
