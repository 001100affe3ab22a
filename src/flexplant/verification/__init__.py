"""Checks that return values: free-free modes, mass properties, compatibility, comparison with a reference."""

from flexplant.model.table import Table
from flexplant.verification.checks import Check, CheckReport
from flexplant.verification.comparison import Comparison, Reference, compare_modes
from flexplant.verification.free_free import undeflated_hz
from flexplant.verification.mass import MassProperties, mass_properties
from flexplant.verification.rigid_body import StrainEnergy, strain_energy
from flexplant.verification.verify import check_component, verify

__all__ = [
    "Check",
    "CheckReport",
    "Comparison",
    "MassProperties",
    "Reference",
    "StrainEnergy",
    "Table",
    "check_component",
    "compare_modes",
    "mass_properties",
    "strain_energy",
    "undeflated_hz",
    "verify",
]
