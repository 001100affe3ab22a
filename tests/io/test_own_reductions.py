"""What a reduction knows survives its file: error rows, report, basis, structural damping, interior DOF."""

from __future__ import annotations

import json

import numpy as np
import pytest
import scipy.sparse as sp

import flexplant as fp
from flexplant.errors import InputError, ReadError

N = 9


def model() -> fp.FiniteElementModel:
    """A free chain of uneven springs."""
    k = np.random.default_rng(3).uniform(1e4, 3e4, N - 1)
    difference = np.diff(np.eye(N), axis=0)
    return fp.FiniteElementModel(
        name="chain",
        mass=sp.csr_array(np.diag(np.random.default_rng(4).uniform(0.5, 2, N))),
        stiffness=sp.csr_array(difference.T @ (k[:, None] * difference)),
        dofs=[(i, 1) for i in range(1, N + 1)],
        nodes=fp.Nodes(np.arange(1, N + 1), np.c_[np.arange(float(N)), np.zeros((N, 2))]),
    )


def reduced(**options) -> fp.Component:
    return fp.craig_bampton(model(), [(1, 1), (N, 1)], max_frequency_hz=20.0, residual_vectors=1, **options)


@pytest.mark.parametrize("ending", ["npz", "h5"])
def test_errors_are_estimated_from_a_file_as_before(tmp_path, ending):
    before = reduced()
    after = fp.read_component(fp.write_component(before, tmp_path / f"chain.{ending}"))
    np.testing.assert_array_equal(after.error_rows, before.error_rows)
    assert after.report == before.report
    ours, theirs = (fp.estimate_error(fp.couple([c])).total for c in (before, after))
    np.testing.assert_array_equal(ours, theirs)
    with pytest.raises(InputError, match="did not keep its basis"):
        fp.expand(after, np.zeros(after.n))


@pytest.mark.parametrize("ending", ["npz", "h5"])
def test_the_basis_comes_back_bit_equal_where_it_was_asked_for(tmp_path, ending):
    before = reduced(keep_basis=True)
    after = fp.read_component(fp.write_component(before, tmp_path / f"chain.{ending}", basis=True))
    np.testing.assert_array_equal(after.basis, before.basis)
    assert after.model_dofs.pairs == before.model_dofs.pairs
    motion = np.random.default_rng(0).standard_normal((before.n, 2))
    np.testing.assert_array_equal(fp.expand(after, motion), fp.expand(before, motion))
    plain = fp.write_component(before, tmp_path / f"plain.{ending}")
    assert fp.read_component(plain).basis is None
    with pytest.raises(InputError, match="no basis to write"):
        fp.write_component(reduced(), tmp_path / f"none.{ending}", basis=True)
    with pytest.raises(InputError, match="no basis to write"):
        fp.write_component(plain_component(), tmp_path / f"none.{ending}", basis=True)


def plain_component(**options) -> fp.Component:
    return fp.Component(name="plain", mass=np.eye(2), stiffness=np.eye(2), boundary=[(1, 1)], **options)


def test_a_basis_in_a_mapped_file_is_written_too(tmp_path):
    mapped = reduced(keep_basis=lambda shape: np.memmap(tmp_path / "basis.bin", dtype=float, mode="w+", shape=shape))
    after = fp.read_component(fp.write_component(mapped, tmp_path / "chain.npz", basis=True))
    np.testing.assert_array_equal(after.basis, mapped.basis)


@pytest.mark.parametrize("ending", ["npz", "h5"])
def test_structural_damping_and_interior_dofs_survive(tmp_path, ending):
    before = reduced(structural_damping=0.04, loads=[(5, 1)])
    after = fp.read_component(fp.write_component(before, tmp_path / f"chain.{ending}"))
    np.testing.assert_array_equal(after.structural_damping, before.structural_damping)
    np.testing.assert_array_equal(after.interior_rows, before.interior_rows)
    names = {"inputs": ["chain.5.1"], "outputs": ["chain.5.1", "chain.9.1"], "frequency_hz": [3.0, 9.0]}
    ours, theirs = (fp.structural_frequency_response(fp.couple([c]), **names) for c in (before, after))
    np.testing.assert_array_equal(ours.values, theirs.values)
    plain = plain_component(structural_damping=np.diag([0.1, 0.2]), interior=[(7, 1)], interior_rows=[[1.0, 2.0]])
    again = fp.read_component(fp.write_component(plain, tmp_path / f"plain.{ending}"))
    np.testing.assert_array_equal(again.structural_damping, plain.structural_damping)
    np.testing.assert_array_equal(again.interior_rows, plain.interior_rows)


def test_formats_without_a_place_for_them_refuse(tmp_path):
    kinds = ("extptfm", {"structural_damping": 0.04}, "structural damping"), ("op4", {"loads": [(5, 1)]}, "interior DOF")
    for narrow, options, words in kinds:
        for ending, reason in ((narrow, words), ("fmu", "none of the endings"), ("zzz", "none of the endings")):
            with pytest.raises(InputError, match=reason) as caught:
                fp.write_component(reduced(**options), tmp_path / f"chain.{ending}")
            assert "\n" not in str(caught.value)
            assert not list(tmp_path.iterdir())


def changed(path, **arrays):
    with np.load(path) as stored:
        kept = {**stored, **arrays}
    np.savez(path, **kept)
    return path


def test_what_does_not_fit_is_told(tmp_path):
    path = fp.write_component(reduced(keep_basis=True), tmp_path / "chain.npz", basis=True)
    with np.load(path) as stored:
        header = json.loads(str(stored["flexplant"]))
    header["reduction"]["report"]["complete_below_hz"] = "high"
    for arrays, words in (
        ({"error_rows": np.zeros((2, 3))}, "error rows has shape"),
        ({"basis": np.zeros((2, 3))}, "basis has shape"),
        ({"flexplant": json.dumps(header)}, "unusable values of complete_below_hz"),
        ({"flexplant": json.dumps(header | {"reduction": 3})}, "chain.npz"),
        ({"flexplant": json.dumps(header | {"reduction": {"report": {"x": 1}, "units": "SI"}})}, "chain.npz"),
    ):
        fp.write_component(reduced(keep_basis=True), path, basis=True)
        with pytest.raises(ReadError, match=words) as caught:
            fp.read_component(changed(path, **arrays))
        assert "\n" not in str(caught.value)


def test_coupled_matrices_hold_structural_damping(tmp_path):
    from flexplant.study.outputs import write_system

    system = fp.couple([reduced(structural_damping=0.04)], method="primal")
    with np.load(write_system(system, tmp_path / "system.npz")) as stored:
        entries = stored["structural_damping_value"], (stored["structural_damping_row"], stored["structural_damping_column"])
        np.testing.assert_array_equal(sp.coo_array(entries, shape=stored["shape"]).toarray(), system.structural_damping.toarray())
    with np.load(write_system(fp.couple([reduced()]), tmp_path / "plain.npz")) as stored:
        assert "structural_damping_value" not in stored
