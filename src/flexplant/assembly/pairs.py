"""What a connection pairs: two nodes, a node and the ground, or two single coordinates."""

from __future__ import annotations

from typing import Any, TypeAlias, TypeGuard

import numpy as np

from flexplant.errors import CouplingError

Pair: TypeAlias = tuple[int, int | None]
DofPair: TypeAlias = tuple[tuple[int, int], tuple[int, int]]


def is_whole(number: object) -> TypeGuard[int]:
    """True for an int, Python's or numpy's."""
    return isinstance(number, (int, np.integer)) and not isinstance(number, bool)


def is_dof_pair(pair: object) -> bool:
    """True for ((node, direction), (node, direction)), judged by its shape alone."""
    return isinstance(pair, (tuple, list)) and len(pair) == 2 and any(isinstance(side, (tuple, list)) for side in pair)


def node_pair(pair: Any, owner: str) -> Pair:
    """(node_a, node_b) as ints."""
    if isinstance(pair, (tuple, list, np.ndarray)) and len(pair) == 2 and all(map(is_whole, pair)):
        return int(pair[0]), int(pair[1])
    shown = pair.tolist() if isinstance(pair, np.ndarray) else pair
    raise CouplingError(f"{owner}: {shown!r:.80} is not a pair of node ids such as (101, 201)")


def grounded_node(pair: Any, owner: str) -> Pair:
    """(node, None) of a node, or of a node paired with nothing."""
    node = pair[0] if isinstance(pair, (tuple, list)) and tuple(pair[1:]) in ((), (None,)) and pair else pair
    if is_whole(node):
        return int(node), None
    raise CouplingError(
        f"{owner}: {pair!r:.80} is not a node to ground; list node ids and name directions, for example "
        "pairs=[101, 102], directions='123'"
    )


def coordinate_pair(pair: Any, owner: str) -> DofPair:
    """((node_a, direction_a), (node_b, direction_b)) as ints."""
    if not all(isinstance(side, (tuple, list)) and len(side) == 2 and all(map(is_whole, side)) for side in pair):
        raise CouplingError(f"{owner}: {pair!r:.80} is not ((node, direction), (node, direction))")
    (node_a, direction_a), (node_b, direction_b) = pair
    return (int(node_a), int(direction_a)), (int(node_b), int(direction_b))
