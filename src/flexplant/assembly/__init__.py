"""Components become a coupled system."""

from flexplant.assembly.characteristic import characteristic_interface
from flexplant.assembly.connection import GROUND, Connection
from flexplant.assembly.couple import couple
from flexplant.assembly.system import System, component_rigid_body, coupled_stiffness_scale, stiffness_scale, system_rigid_body

__all__ = [
    "GROUND",
    "Connection",
    "System",
    "characteristic_interface",
    "component_rigid_body",
    "couple",
    "coupled_stiffness_scale",
    "stiffness_scale",
    "system_rigid_body",
]
