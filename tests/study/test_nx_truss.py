"""The study over two Nastran superelements, against NX Nastran's assembled solution."""

import importlib.util
import shutil
from pathlib import Path

import numpy as np
import pytest

from flexplant.study.pipeline import run_study
from flexplant.study.result import StudyResult
from flexplant.verification import mass_properties

STUDY = Path(__file__).parents[2] / "examples" / "nx_truss" / "study.yaml"
# NX Nastran 9.1, modes of the two EXTSEOUT superelements, Hz (elastic ones), in double precision
ELASTIC_HZ = [
    1.6988002150369577, 1.7674874041104807, 1.8577204498080995, 3.419612252718385, 7.024211134438172, 7.025409264171152,
    10.723613309641603, 10.982549254727832, 13.866787390122482, 14.38990594371398, 14.650850439911311, 15.192785733423161,
    25.201542408952818, 25.313492968083683, 29.12903189008605, 42.436722258207574, 43.086598990538725, 46.894373775666956,
    47.80847787804744, 69.44509760736513, 87.46187723026873, 97.90689308152626, 100.85448573702764, 113.23295390109539,
    187.2003146000972, 209.32137287377793, 236.5214214420805, 253.20278474481842, 394.22334041905975, 472.86770990275255,
    585.2301905466396, 657.0995886984557, 662.1878528847591, 744.9397024309011, 816.7069672584066, 875.6077236080915,
    940.4573189324169, 945.4732245822456, 1005.6116634970609, 1010.7171470498417, 1075.721372805245, 1161.0107763907565,
    1233.9979752420634, 1372.1001576904928, 1610.2766407083218, 1941.3171689359015, 2410.198065904828, 4937.1522799384065,
]  # fmt: skip
# ... and displacements at 2 Hz in mm and rad for 1 mN at grid 11, direction 1 of its frame; single precision
RESPONSE = {
    (3,1): 0.0001110682642320171, (3,2): -0.0016538064228370786, (3,3): 0.00023429970315191895, (3,4):
    -1.5579860246361932e-06, (3,5): 1.7785435346695522e-08, (3,6): 7.355480988735508e-07, (11,1): -0.0016535859322175384,
    (11,2): -0.00023437515483237803, (11,3): -0.00011073454516008496, (11,4): -1.549710226811385e-08, (11,5):
    7.332323548325803e-07, (11,6): -1.5597510127918213e-06, (19,1): -0.00011079842079197988, (19,2): -0.0021223491057753563,
    (19,3): -0.0002343234809814021, (19,4): -1.5651316971343476e-06, (19,5): 1.5974620737324585e-08, (19,6):
    7.334336942221853e-07, (27,1): 0.00011106301826657727, (27,2): -0.00212231301702559, (27,3): 0.00023425157996825874,
    (27,4): -1.5643094002371072e-06, (27,5): -1.7922506145851003e-08, (27,6): 7.353852424785146e-07,
}  # fmt: skip
MASS_KG, CENTER_MM = 3.3454356270132592, [633.3701743060683, 149.9999999994939, 149.99999999977732]
INERTIA_KG_MM2 = [392837.936921639, 1023789.8517608833, 1354959.0324549056]


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> StudyResult:
    """The study of the examples, run where pyYeti's copy of the superelements lies beside it."""
    folder = tmp_path_factory.mktemp("truss")
    package = importlib.util.find_spec("pyyeti")
    assert package is not None
    assert package.origin is not None
    for name in ("inboard", "outboard"):
        for suffix in (".op4", ".asm", ".pch"):
            shutil.copy(Path(package.origin).parent / "tests" / "nas2cam_extseout" / (name + suffix), folder)
    shutil.copy(STUDY, folder)
    return run_study(folder / "study.yaml", output=folder / "out")


def test_all_checks_pass_and_everything_is_written(result):
    assert result.checks.passed
    assert result.modes.n_rigid == 6
    assert all(path.is_file() for path in result.files.values())


def test_all_48_elastic_frequencies_are_those_of_nastran(result):
    np.testing.assert_allclose(result.modes.frequency_hz[6:], ELASTIC_HZ, rtol=1e-6)


def test_mass_properties_are_those_of_the_solver(result):
    found = mass_properties(result.system)
    assert found.mass == pytest.approx(MASS_KG, rel=1e-6)
    np.testing.assert_allclose(1e3 * found.center_of_gravity, CENTER_MM, rtol=1e-6)
    np.testing.assert_allclose(1e6 * np.diag(found.inertia), INERTIA_KG_MM2, rtol=1e-6)


def test_the_2_hz_response_is_that_of_nastran(result):
    """A force of 1 mN is 1e-3 N, and 1 m is 1e3 mm: translations in mm per mN equal m per N, rotations scale by 1e-3."""
    largest = max(abs(v) for v in RESPONSE.values())
    for (grid, direction), expected in RESPONSE.items():
        value = result.response.sel(output=f"outboard.{grid}.{direction}", input="outboard.11.1").values[0]
        ours = value * (1.0 if direction <= 3 else 1e-3)
        assert abs(ours.real - expected) < 1e-5 * largest
        assert abs(ours.imag) < 1e-12


def test_the_report_shows_modes_and_the_response_where_nothing_is_compared(result):
    page = result.files["report"].read_text(encoding="utf-8")
    assert "Modes of the coupled system" in page
    assert "Response at 2 Hz" in page
    assert "1 input, 24 outputs, no damping, all modes kept" in page
