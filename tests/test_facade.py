"""The public face: every name loads, is documented, and importing the package stays light."""

from __future__ import annotations

import inspect
import subprocess
import sys

import pytest

import flexplant as fp
from flexplant.errors import FlexplantError, MissingExtraError, ReadError, nearest

STABLE = [
    "read_component",
    "read_model",
    "Component",
    "FiniteElementModel",
    "craig_bampton",
    "Nodes",
    "Connection",
    "Placement",
    "couple",
    "normal_modes",
    "mass_properties",
    "verify",
    "ModalPlant",
    "modal_plant",
    "descriptor",
    "state_space",
    "discretize",
    "frequency_response",
    "singular_values",
    "hinf_norm",
    "harmonic_response",
    "random_response",
    "simulate",
    "run_study",
]


@pytest.mark.parametrize("name", sorted(set(fp.__all__) - {"__version__"}))
def test_every_public_name_loads_and_is_documented(name):
    value = getattr(fp, name)
    if callable(value):
        assert inspect.getdoc(value)


@pytest.mark.parametrize("name", STABLE)
def test_stable_names_are_public(name):
    assert name in dir(fp)


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'coupel'"):
        _ = fp.coupel


def test_importing_brings_no_heavy_package():
    code = "import sys, flexplant; print(*sorted({m.split('.')[0] for m in sys.modules}))"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not {"numpy", "scipy", "xarray", "plotly", "pandas", "h5py", "pydantic", "control", "pyyeti", "numba"} & set(loaded)


def test_errors_are_one_family_and_say_where():
    error = ReadError("bus.op4", "ends early", record="KXX", offset=12)
    assert str(error) == "bus.op4, record KXX, byte 12: ends early"
    assert isinstance(error, FlexplantError)
    assert "flexplant[fast]" in str(MissingExtraError("rslab", "fast"))
    assert "bus.9001.1" in nearest("bus.9001.l", ["bus.9001.1", "optic.9101.1"])
    assert nearest("x", []) == " There are none."
