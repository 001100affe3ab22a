"""Our Julia files through Julia's own parser: numbers bit by bit, brackets and operators as Julia groups them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from exported_plants import kinds
from julia_tree import FUNCTIONS, evaluate, julia_tree, system

from flexplant.io import write_plant
from flexplant.plant.state_space import Descriptor, StateSpace, state_space

pytest.importorskip("ace_jax_coupling", reason="no Julia parser (pip install ace-jax-coupling carries one)")


@pytest.mark.parametrize("kind", list(kinds()))
def test_julia_groups_the_file_into_our_state_space(tmp_path: Path, kind: str) -> None:
    given = kinds()[kind]
    tree = julia_tree(write_plant(given, tmp_path / "p.jl"))
    found, form = system(tree, "p_system"), state_space(given) if not isinstance(given, StateSpace) else given
    assert (found[4] if len(found) > 4 else None) == form.dt
    for matrix, name in zip(found, "ABCD", strict=False):
        np.testing.assert_array_equal(matrix, getattr(form, name))
    known = dict(FUNCTIONS)
    for item in tree[1:]:
        evaluate(item, known)
    assert (known["p_inputs"], known["p_outputs"]) == (list(given.inputs), list(given.outputs))


def test_extreme_numbers_and_names_survive_julias_reader(tmp_path: Path) -> None:
    odd = ['a"b', "c$d", "e\\f", "g·m²"]
    values = np.array([[-0.0, 5e-324, -1.7976931348623157e308, 1 / 3], [1e-300, -1e22, 0.1, 2.0**-1074]])
    given = Descriptor(np.eye(2), -np.eye(2), values, np.eye(2), np.zeros((2, 4)), inputs=odd, outputs=["y", "z"])
    tree = julia_tree(write_plant(given, tmp_path / "p.jl"))
    A, E, B, C, D = system(tree, "p_system")
    np.testing.assert_array_equal(B, values)
    assert np.signbit(B[0, 0])
    for ours, seen in ((given.A, A), (given.E, E), (given.C, C), (given.D, D)):
        np.testing.assert_array_equal(seen, ours.toarray() if hasattr(ours, "toarray") else ours)


def test_an_error_of_julias_parser_is_seen(tmp_path: Path) -> None:
    """The route notices: what Julia cannot read is a tree that cannot be evaluated."""
    (tmp_path / "p.jl").write_text("function p_system(\n")
    with pytest.raises((KeyError, ValueError, AssertionError, IndexError)):
        system(julia_tree(tmp_path / "p.jl"), "p_system")
