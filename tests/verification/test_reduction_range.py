"""`verify` says how far reduced components can be trusted: completeness, estimated errors against the whole, vendor files."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
import scipy.sparse as sp

import flexplant as fp
from flexplant.errors import InputError

LENGTH, RANGE_HZ = 40, 60.0


def chain(name, seed):
    """Masses and springs along x."""
    rng = np.random.default_rng(seed)
    k = rng.uniform(2e4, 4e4, LENGTH - 1)
    stiffness = sp.diags_array([np.r_[k, 0] + np.r_[0, k], -k, -k], offsets=[0, 1, -1]).tocsr()
    return fp.FiniteElementModel(
        name=name, mass=np.diag(rng.uniform(0.05, 0.2, LENGTH)), stiffness=stiffness, dofs=[(i + 1, 1) for i in range(LENGTH)]
    )


def whole_hz(count):
    """Elastic frequencies of both chains joined at their ends, unreduced."""
    left, right = chain("left", 1), chain("right", 2)
    n = 2 * LENGTH - 1
    k, m = np.zeros((n, n)), np.zeros((n, n))
    for model, at in ((left, slice(0, LENGTH)), (right, slice(LENGTH - 1, n))):
        k[at, at] += model.stiffness.toarray()
        m[at, at] += np.asarray(model.mass.toarray() if sp.issparse(model.mass) else model.mass)
    model = fp.FiniteElementModel(name="whole", mass=m, stiffness=k, dofs=[(i + 1, 1) for i in range(n)])
    return fp.normal_modes(model).frequency_hz[1 : 1 + count]


def joined(left, right):
    joint = fp.Connection("left", "right", pairs=[(LENGTH, 1)], directions="1")
    return fp.couple([left, right], [joint])


def reduced(**options):
    ends = [(1, 1), (LENGTH, 1)]
    return joined(*(fp.craig_bampton(chain(name, seed), ends, **options) for name, seed in (("left", 1), ("right", 2))))


def plain(component):
    """As a file of another program gives it: nobody knows how it was reduced."""
    return fp.Component(**{f.name: getattr(component, f.name) for f in fields(fp.Component) if f.init})


def test_a_range_beyond_the_reductions_fails_and_names_each_component():
    system = reduced(max_frequency_hz=40.0)
    report = fp.verify(system, rigid_body_modes=1, max_frequency_hz=RANGE_HZ)
    for name in ("left", "right"):
        complete = system.component(name).report.complete_below_hz
        check = report[f"{name}: modes complete up to the frequency asked"]
        assert not check.passed
        assert 40.0 <= check.value == complete < RANGE_HZ
        assert check.limit == RANGE_HZ
        assert f"asked up to 60 Hz, but component '{name}' is complete only below {complete:.4g} Hz" in check.explanation


def test_one_short_component_is_told_from_the_other():
    short = fp.craig_bampton(chain("left", 1), [(1, 1), (LENGTH, 1)], max_frequency_hz=40.0)
    long = fp.craig_bampton(chain("right", 2), [(1, 1), (LENGTH, 1)], max_frequency_hz=150.0, residual_vectors=1)
    report = fp.verify(joined(short, long), rigid_body_modes=1, max_frequency_hz=38.0)
    assert report["left: modes complete up to the frequency asked"].passed
    assert report["right: modes complete up to the frequency asked"].passed
    assert "mostly from component 'left'" in report["estimated frequency error of the reductions"].explanation


@pytest.mark.parametrize(
    "options", [{"max_frequency_hz": 66.0}, {"max_frequency_hz": 90.0}, {"max_frequency_hz": 150.0, "residual_vectors": 1}]
)
def test_estimates_in_the_table_contain_the_true_errors(options):
    system = reduced(**options)
    report = fp.verify(system, rigid_body_modes=1, max_frequency_hz=RANGE_HZ)
    (table,) = (t for t in report.tables if t.title.startswith("Estimated"))
    hz = np.array([row[1] for row in table.rows])
    error = np.array([row[2] for row in table.rows]) / 100
    true = hz / whole_hz(hz.size) - 1
    assert hz.size > 3
    assert (error >= true * (1 - 1e-6) - 1e-12).all()
    shares = np.array([row[3:5] for row in table.rows], dtype=float)
    np.testing.assert_allclose(shares.sum(axis=1), 100 * error, rtol=1e-12)
    check = report["estimated frequency error of the reductions"]
    assert check.value == pytest.approx(100 * error.max())
    assert check.passed == (error.max() <= 0.01)
    assert all(report[f"{name}: modes complete up to the frequency asked"].passed for name in ("left", "right"))


def test_the_limit_is_the_callers():
    system = reduced(max_frequency_hz=66.0)
    name = "estimated frequency error of the reductions"
    assert not fp.verify(system, rigid_body_modes=1, max_frequency_hz=RANGE_HZ, reduction_error=1e-6)[name].passed
    assert fp.verify(system, rigid_body_modes=1, max_frequency_hz=RANGE_HZ, reduction_error=1e6)[name].passed


def test_the_given_modes_may_end_at_the_range():
    """Errors mix with modes above the range, so they do not depend on where the given modes end."""
    system = reduced(max_frequency_hz=66.0)
    few = fp.verify(
        system, rigid_body_modes=1, max_frequency_hz=RANGE_HZ, modes=fp.normal_modes(system, max_frequency_hz=RANGE_HZ)
    )
    all_of_them = fp.verify(system, rigid_body_modes=1, max_frequency_hz=RANGE_HZ)
    assert few.tables == all_of_them.tables


def test_without_a_range_nothing_fails_but_a_note_says_where_trust_ends():
    system = reduced(max_frequency_hz=40.0)
    report = fp.verify(system, rigid_body_modes=1)
    assert report.passed
    assert not any("complete" in c.name for c in report.checks)
    complete = min(c.report.complete_below_hz for c in system.components)
    text = f"modes above {complete:.4g} Hz are not vouched for: the components' own modes are complete only below it"
    assert text in report.notes


def test_components_of_unknown_reduction_get_a_note():
    system = reduced(max_frequency_hz=66.0)
    foreign = joined(*(plain(c) for c in system.components))
    report = fp.verify(foreign, rigid_body_modes=1, max_frequency_hz=RANGE_HZ)
    assert report.passed
    highest = system.components[0].fixed_interface_hz.max()
    note = next(n for n in report.notes if "'left'" in n and "vouched" in n)
    assert f"end at {highest:.4g} Hz" in note
    assert f"above {highest / 2:.4g} to {highest / 1.5:.4g} Hz" in note
    assert not any("vouched" in n for n in fp.verify(foreign, rigid_body_modes=1, max_frequency_hz=highest / 2.1).notes)


def test_a_known_component_beside_an_unknown_one():
    system = reduced(max_frequency_hz=90.0)
    report = fp.verify(joined(plain(system.components[0]), system.components[1]), rigid_body_modes=1, max_frequency_hz=RANGE_HZ)
    assert "estimated frequency errors do not contain those of left" in report.notes
    assert report["right: modes complete up to the frequency asked"].passed


def test_static_condensation_vouches_for_nothing():
    system = joined(*(fp.guyan(chain(name, seed), [(1, 1), (LENGTH, 1)]) for name, seed in (("left", 1), ("right", 2))))
    report = fp.verify(system, rigid_body_modes=1, max_frequency_hz=RANGE_HZ)
    assert not any("complete" in c.name or "estimated" in c.name for c in report.checks)
    assert sum("has no modal coordinates" in n for n in report.notes) == 2


@pytest.mark.parametrize("wrong", [0, -5.0, np.nan, np.inf, "60", True])
def test_a_wrong_range_is_refused(wrong):
    with pytest.raises(InputError, match="verify: max_frequency_hz"):
        fp.verify(reduced(max_frequency_hz=66.0), rigid_body_modes=1, max_frequency_hz=wrong)
