"""What is no path is told in one line, wherever a file is read or written."""

from __future__ import annotations

import pytest

import flexplant as fp
from flexplant.errors import InputError
from flexplant.model.component import Component


@pytest.mark.parametrize("path", [None, 5, ["bus.op4"]])
def test_no_path_at_all(path):
    component = Component(name="c", mass=[[1.0]], stiffness=[[0.0]], boundary=[(1, 1)])
    for call in (fp.read_component, fp.read_model, fp.run_study, lambda p: fp.write_component(component, p)):
        with pytest.raises(InputError, match=f"path is needed.*{type(path).__name__}"):
            call(path)
