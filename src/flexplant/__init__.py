"""Flexible structural plants for control simulation.

    read -> reduce -> couple -> verify -> plant -> respond / close the loop -> report / export

Each step is one call on frozen values; see `docs/theory.md` for the equation behind each name. Names load on first use, so
that `import flexplant` stays fast.
"""

from __future__ import annotations

import importlib
from typing import Any

__version__ = "0.1.0"

_HOME = {
    "errors": (
        *("FlexplantError", "InputError", "ModelError", "CouplingError", "ReadError", "SolverError"),
        *("LeftOutWarning", "PlausibilityWarning"),
    ),
    "model.component": ("Component", "FiniteElementModel"),
    "model.damping": ("with_equivalent_viscous_damping", "with_modal_damping"),
    "model.dofs": ("DofSet",),
    "model.geometry": ("Nodes", "Placement", "cylindrical_frame", "rigid_body_vectors"),
    "model.recovery": ("Recovery",),
    "model.conversion": ("component_to_si", "model_to_si"),
    "model.units": ("UNIT_SYSTEMS", "UnitSystem"),
    "reduction": (
        "characteristic_constraint_modes",
        "craig_bampton",
        "expand",
        "expansion",
        "guyan",
        "rubin",
        "with_dampers",
        "with_interface_node",
        "with_proportional_damping",
    ),
    "assembly": ("Connection", "System", "characteristic_interface", "couple"),
    "modes": ("Modes", "effective_mass", "mac", "normal_modes"),
    "verification": ("Check", "CheckReport", "Reference", "check_component", "mass_properties", "strain_energy", "verify"),
    "verification.reduction_error": ("estimate_error",),
    "plant.modal": ("ModalPlant", "modal_plant", "select"),
    "plant.descriptor": ("descriptor",),
    "plant.state_space": ("Descriptor", "StateSpace", "state_space"),
    "plant.rigid_body": ("without_rigid_body",),
    "plant.truncation": ("hankel_singular_values", "peak_gains", "reduce_modes"),
    "plant.balanced": ("balanced_truncation",),
    "plant.conversion": ("from_control", "from_scipy", "to_control", "to_scipy"),
    "response.norms": ("singular_values",),
    "response.margins": ("bandwidth_hz", "complementary_sensitivity", "crossing_hz", "sensitivity"),
    "response.structural": ("structural_frequency_response",),
    "response.gain_sweep": ("GainSweep",),
    "loop.grids": ("adaptive_grid",),
    "response.h2": ("h2_norm", "white_noise_rms"),
    "loop.diagram": ("Diagram",),
    "loop.close": ("close",),
    "loop.discretize": ("discretize",),
    "loop.frequency": ("frequency_response", "frequency_response_blocks"),
    "loop.harmonic": ("harmonic_response", "wheel_speed_sweep"),
    "loop.loop_response": ("loop_margins", "loop_response"),
    "loop.margins": ("margins",),
    "loop.norms": ("hinf_norm",),
    "loop.line_of_sight": ("LineOfSight", "closed_loop_transfer", "line_of_sight_diagram", "loop_gain", "output_sensitivity"),
    "loop.figures_of_merit": ("loop_figures",),
    "loop.random": ("random_response",),
    "loop.simulate": ("simulate",),
    "loop.stream": ("simulate_stream",),
    "blocks.basic": ("gain", "renamed", "summing_junction"),
    "blocks.controllers": ("proportional",),
    "blocks.delay": ("pade_delay", "sample_delay"),
    "blocks.mirror": ("steering_mirror",),
    "blocks.optics": ("angle_sensor", "flat_mirror", "line_of_sight_geometry", "thin_lens"),
    "blocks.pid": ("pid",),
    "blocks.sampled": ("dead_zone", "quantiser", "rate_limiter", "saturation", "user_block"),
    "blocks.tones": ("Tones", "tone_signal"),
    "blocks.transfer_function": ("transfer_function",),
    "blocks.wheel": ("Wheel", "wheel_disturbance", "wheel_tones"),
    "io": (
        "convert",
        "inspect",
        "plausibility",
        "read_component",
        "read_display_mesh",
        "read_geometry",
        "read_model",
        "read_plant",
        "read_reference",
        "read_response_functions",
        "read_results",
        "write_component",
        "write_model",
        "write_plant",
        "write_results",
    ),
    "report.figures.plot": ("plot",),
    "report.mode_view": ("mode_view",),
    "study.pipeline": ("run_study",),
    "study.examples": ("example_study",),
}
_WHERE = {name: module for module, names in _HOME.items() for name in names}

__all__ = sorted([*_WHERE, "__version__"])


def __getattr__(name: str) -> Any:
    if name not in _WHERE:
        raise AttributeError(f"module 'flexplant' has no attribute {name!r}")
    value = getattr(importlib.import_module(f"flexplant.{_WHERE[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
