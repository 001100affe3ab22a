"""Port names "block.port", and the kind of quantity a port's unit text stands for."""

from __future__ import annotations

from collections.abc import Mapping

from flexplant.blocks.sampled import SampledBlock
from flexplant.errors import DiagramError, nearest
from flexplant.plant.modal import ModalPlant
from flexplant.plant.state_space import StateSpace

LinearBlock = StateSpace | ModalPlant
Block = LinearBlock | SampledBlock

KINDS = {"m": "length", "rad": "angle", "V": "voltage", "N": "force", "Nm": "moment", "m/s": "velocity", "rad/s": "rate"}


def split_port(port: str, blocks: Mapping[str, Block]) -> tuple[str, str]:
    """(block, port) of "block.port"; only the first dot separates, so plant channels keep theirs. DiagramError if unknown."""
    block, dot, name = port.partition(".")
    if not dot:
        raise DiagramError(f"port {port!r} has no block; write 'block.port'." + nearest(port, blocks))
    if block not in blocks:
        raise DiagramError(f"port {port!r}: there is no block {block!r}." + nearest(block, blocks))
    return block, name


def find_port(port: str, blocks: Mapping[str, Block], side: str) -> tuple[str, int]:
    """(block, index) of an input or output port (side "inputs" or "outputs"); DiagramError suggests the nearest name."""
    block, name = split_port(port, blocks)
    names = list(getattr(blocks[block], side))
    if name not in names:
        known = [f"{block}.{n}" for n in names]
        raise DiagramError(f"block {block!r} has no {side[:-1]} {name!r}." + nearest(port, known))
    return block, names.index(name)


def kind(unit: str) -> str:
    """The quantity with its unit, such as "length [m]"; "" for a port without a unit, which fits any other."""
    text = unit.replace(" ", "").replace("*", "").replace("·", "")
    if not text:
        return ""
    return f"{KINDS[text]} [{text}]" if text in KINDS else f"[{text}]"
