"""Studies that reduce by every method, with patches and interfaces in few coordinates, against LAPACK on unreduced models."""

from __future__ import annotations

import importlib.util
import shutil
from pathlib import Path

import numpy as np
import pytest

import flexplant as fp
from flexplant.errors import FlexplantError, StudyError
from flexplant.study.pipeline import run_study
from flexplant.study.reporting import report

EXAMPLE = Path(__file__).parents[2] / "examples" / "bolted_plate"
EDGE = '[9001, "123456"], ["97-108", "123"]'


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The example's folder with the files that its script makes."""
    spec = importlib.util.spec_from_file_location("bolted_plate", EXAMPLE / "make.py")
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    target = tmp_path_factory.mktemp("plate")
    for study in EXAMPLE.glob("*.yaml"):
        shutil.copy(study, target)
    script.make(target)
    return target


def changed(folder: Path, name: str, *changes: tuple[str, str]):
    """The finished study after some changes of its text."""
    text = (folder / f"{name}.yaml").read_text()
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    (folder / "changed.yaml").write_text(text)
    return run_study(folder / "changed.yaml")


def test_rubin_with_a_bolted_patch_has_the_modes_of_the_unreduced_plate(folder):
    found = run_study(folder / "rubin.yaml")
    assert found.checks.passed
    assert found.compared.worst_percent < 1e-7
    (plate,) = found.system.components
    assert plate.boundary.pairs == [(9001, d) for d in range(1, 7)]
    assert plate.interior.pairs == [(108, 3)]
    words = "Reduced here: plate by Rubin from 324 DOF to 6 boundary and 27 modal DOF, node 9001 averaging its patch."
    assert words in found.text()
    assert "Estimated frequency errors of the reductions up to 4500 Hz: below round-off" in found.text()
    assert "reducing plate" in found.seconds
    (section,) = (s for s in report(found, None).sections if s.heading == "Reductions")
    assert section.items[0] == words
    assert section.items[1].rows[0][:6] == ("plate", "Rubin", 324, 6, 27, "")


def test_an_edge_in_characteristic_modes_is_as_good_as_the_estimate_says(folder):
    found = changed(folder, "characteristic", ("residual_vectors: 1", "residual_vectors: 1\n      keep_basis: true"))
    (plate,) = found.system.components
    assert found.checks.passed
    errors = found.compared.every.error_percent
    estimated = np.array([row[2] for t in found.tables if t.title.startswith("Estimated") for row in t.rows])
    assert (errors <= estimated * (1 + 1e-6)).all()
    assert 0 < errors.max() < 0.01
    assert plate.basis.shape == (324, 6 + 10 + 42 + 12)
    assert "12 coordinates standing for 36 DOF of its interface" in found.text()
    assert fp.expand(plate, found.modes.shapes[:, :7]).shape == (324, 7)
    whole = changed(folder, "characteristic", (", n_modes: 12}", ", n_modes: 36}")).compared
    assert abs(whole.every.error_percent).max() < abs(errors).max() / 20


def test_two_plates_share_their_reduced_interface(folder):
    found = run_study(folder / "pair.yaml")
    assert found.checks.passed
    left, right = found.system.components
    assert left.boundary.pairs[3:] == right.boundary.pairs[3:], "the same coordinates on both sides"
    assert found.system.basis.shape[1] == left.n + right.n - 18
    errors = found.compared.every.error_percent
    estimated = np.array([row[2] for t in found.tables if t.title.startswith("Estimated") for row in t.rows])
    assert (errors <= estimated * (1 + 1e-6)).all()
    assert 0 < errors.max() < 0.01
    assert found.text().count("18 coordinates standing for 36 DOF of its interface") == 2


def test_guyan_keeps_statics_and_damping_of_characteristic_modes_is_given_after_them(folder):
    reference = "  reference: {file: plate_hz.txt, name: unreduced plate, limit: 1.0e-6, modes: 8}"
    changes = {
        "method: rubin": "method: guyan",
        '      loads: [[108, "3"]]': '      recover: [[108, "3"]]',
        "      n_modes: 20\n": "",
        "plate.108.3": "plate.displacement.108.3",
        reference: "  rigid_body_modes: 6",
        "max_frequency_hz: 4500": "static_correction: false",
    }
    (plate,) = changed(folder, "rubin", *changes.items()).system.components
    assert (plate.n_modal, plate.report.method) == (0, "Guyan")
    assert plate.recovery["displacement"].labels == ("108.3",)
    (damped,) = changed(folder, "characteristic", ("file: plate.npz", "file: plate.npz\n    damping: 0.02")).system.components
    np.testing.assert_allclose(np.diagonal(damped.damping)[6:], 2 * 0.02 * 2 * np.pi * damped.fixed_interface_hz, rtol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "line", "said"),
    [
        ("method: craig_bampton", "method: Guyan", 9, "'craig_bampton', 'rubin' or 'guyan'"),
        (
            "method: craig_bampton",
            "method: rubin",
            8,
            "residual_vectors is no option of method rubin, which has max_frequency_hz",
        ),
        ("method: craig_bampton", "method: guyan", 8, "leave it out, or take method craig_bampton or rubin"),
        ("kind: average, ", "", 11, "interface_nodes.0: the key 'kind' is missing"),
        ("radius_m: 0.06", "patch: [1]", 11, "interface_nodes.0: an averaging patch needs three nodes or more"),
        ("radius_m: 0.06", "patch: [1, 2-4, 3]", 11, "interface_nodes.0.patch: lists 3 twice"),
        ("radius_m: 0.06", "patch: [4-2]", 11, "from the lower to the higher"),
        ("radius_m: 0.06", "patch: [1-999999]", 11, "at most 100000"),
        ("radius_m: 0.06", "radius_m: 0.06, patch: [1, 2, 3]", 11, "give either patch, a list of nodes, or radius_m"),
        ("position_m: [0.1, 0.1, 0.0], ", "", 11, "radius_m needs position_m"),
        ("radius_m: 0.06", "radius_m: 0.06, directions: '123'", 11, "directions is no option of kind: average"),
        (EDGE, EDGE + ", [99, '3']", 12, "reduce.boundary: lists 99-3 twice"),
        (EDGE, '["97-108", "123"]', 8, "interface node 9001 is neither in boundary nor in loads"),
        (EDGE, '[9001, "123456"], [97, "7"]', 12, "interface, loads"),
        (", n_modes: 12}", "}", 15, "characteristic_modes: give either max_frequency_hz or n_modes"),
        ('{keep: [[9001, "123456"]], n', "{n", 15, "characteristic_modes: the key 'keep' is missing"),
    ],
)
def test_mistakes_name_component_key_and_line(folder, old, new, line, said):
    with pytest.raises(StudyError) as caught:
        changed(folder, "characteristic", (old, new))
    assert f"line {line}: components.plate.reduce" in str(caught.value)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("study", "old", "new", "line", "said"),
    [
        (
            "characteristic",
            "radius_m: 0.06",
            "patch: [1-3, 900]",
            11,
            "interface_nodes.0 (node 9001): model 'plate' has no node 900",
        ),
        ("characteristic", "97-108", "1-40", 8, "node 17 is in the patch of interface node 9001"),
        (
            "characteristic",
            'keep: [[9001, "123456"]]',
            "keep: [[5, '1']]",
            15,
            "characteristic_modes: component 'plate' has no node 5",
        ),
        ("rubin", '[[9001, "123456"]]', '[[9001, "123"]]', 8, "reduce: model 'plate': with the boundary held the interior still"),
        (
            "pair",
            "n_modes: 12}}",
            "n_modes: 37}}",
            16,
            "connections.0.characteristic_modes: characteristic_interface: 37 modes of",
        ),
        ("pair", '"123", char', '"123", stiffness: [1, 1, 1], char', 15, "those of a rigid interface"),
        ("rubin", "plate.npz", "plate.npz\n    damping: [0.1, 0.1]", 9, "components.plate.reduce: component 'plate': damping"),
    ],
)
def test_what_only_the_model_tells_names_the_key_too(folder, study, old, new, line, said):
    with pytest.raises(FlexplantError) as caught:
        changed(folder, study, (old, new))
    assert f"changed.yaml, line {line}: " in str(caught.value)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
