"""A small study in a folder: the chain of `structures.py` cut in two, and the unsplit chain as the truth."""

from pathlib import Path

from structures import chain, chain_halves

from flexplant.io import write_component, write_model

STUDY = """\
title: Two halves of a chain
components:
  left: {file: left.npz}
  right: {file: right.npz}
connections:
  - {a: left, b: right, nodes: [4]}
damping: {ratio: 0.01}
verification:
  rigid_body_modes: 6
plant:
  inputs: [left.1.123456]
  outputs: [right.6.12]
response: {from_hz: 5, to_hz: 200, points: 50}
truth:
  file: whole.npz
  input: left.1.1
  output: right.6.1
  structural_damping: 0.02
  frequency: {from_hz: 5, to_hz: 200, points: 20}
"""

LINE_OF_SIGHT = """\
line_of_sight:
  wheel: {node: left.1, amplitude: 5e-6, harmonics: [1, 2], phases_deg: [0, 90, 0, 0, 90, 0], speeds_hz: [20]}
  optics: {x: right.6.1, y: right.6.2, focal_length_m: 1.5, mirror_omega_rad_s: 100, mirror_zeta: 0.3}
  controller: {proportional_gain: [1800, 1800]}
  time: {duration_s: 0.1, step_s: 1e-3}
  sweep: {from_hz: 10, to_hz: 20, points: 5}
  frequency: {from_hz: 5, to_hz: 200, points: 50}
"""


def write_study(folder: Path, text: str = STUDY) -> Path:
    """The study file, with the files it names beside it."""
    for component in chain_halves():
        write_component(component, folder / f"{component.name}.npz")
    write_model(chain(), folder / "whole.npz")
    (folder / "study.yaml").write_text(text)
    return folder / "study.yaml"
