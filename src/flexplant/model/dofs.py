"""Degrees of freedom: (node, direction) pairs and their look-up."""

from __future__ import annotations

import operator
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from flexplant.errors import ModelError, nearest
from flexplant.model.arrays import IntArray, frozen, items_of
from flexplant.model.describe import dof_text

DIRECTIONS = "123456"


def expand_directions(directions: str | int | Iterable[int]) -> tuple[int, ...]:
    """Directions 1-6 (0 = scalar) from "123", 123, 3 or [1, 2, 3]; raises ModelError for anything else."""
    single = isinstance(directions, (str, int, np.integer))
    text = str(directions) if single else "".join(str(d) for d in items_of(directions) or ())
    if not text or any(c not in "0" + DIRECTIONS for c in text) or len(set(text)) != len(text):
        raise ModelError(f"directions {directions!r}: use distinct digits 1-6 (1-3 translations, 4-6 rotations), 0 for scalar")
    return tuple(int(c) for c in text)


@dataclass(frozen=True, eq=False)
class DofSet:
    """An ordered set of distinct degrees of freedom.

    node: (n,) int ids. direction: (n,) ints, 1-3 translation, 4-6 rotation, 0 scalar or modal.
    """

    node: IntArray
    direction: IntArray

    def __post_init__(self) -> None:
        node = frozen(self.node, np.int64, what="DOF set: node ids")
        direction = frozen(self.direction, np.int64, what="DOF set: directions")
        if node.ndim != 1 or node.shape != direction.shape:
            raise ModelError(f"DOF set: node has shape {node.shape}, direction {direction.shape}; both must be (n,)")
        if direction.size and (direction.min() < 0 or direction.max() > 6):
            raise ModelError(f"DOF set: directions must lie in 0-6, got {sorted(set(direction.tolist()) - set(range(7)))}")
        object.__setattr__(self, "node", node)
        object.__setattr__(self, "direction", direction)
        if len(self._row) != node.size:
            seen: set[tuple[int, int]] = set()
            twice = [p for p in self.pairs if p in seen or seen.add(p)]  # type: ignore[func-returns-value]
            raise ModelError(f"DOF set: listed twice: {', '.join(f'{n}-{d}' for n, d in twice[:8])}")

    @classmethod
    def of(cls, pairs: DofSet | Iterable[tuple[int, int | str]]) -> DofSet:
        """From [(node, direction), ...]; a direction may also be a string such as "123456"."""
        if isinstance(pairs, DofSet):
            return pairs
        try:
            if (pairs := items_of(pairs)) is None:  # type: ignore[assignment]
                raise TypeError("this is a text, has no order or lists nothing")
            rows = [(operator.index(node), d) for node, direction in pairs for d in expand_directions(direction)]
            return cls(np.array([r[0] for r in rows], dtype=np.int64), np.array([r[1] for r in rows], dtype=np.int64))
        except (TypeError, ValueError, OverflowError) as error:
            if isinstance(error, ModelError):
                raise
            raise ModelError(f"DOF must be (node, direction) pairs such as (101, 1) or (101, '123456'): {error}") from None

    @cached_property
    def pairs(self) -> list[tuple[int, int]]:
        """[(node, direction), ...] as plain ints."""
        return list(zip(self.node.tolist(), self.direction.tolist(), strict=True))

    @cached_property
    def _row(self) -> dict[tuple[int, int], int]:
        return {pair: i for i, pair in enumerate(self.pairs)}

    @cached_property
    def nodes(self) -> list[int]:
        """Distinct node ids in order of first appearance, scalar (direction 0) rows left out."""
        return list(dict.fromkeys(n for n, d in self.pairs if d))

    def __repr__(self) -> str:
        return f"DofSet of {len(self)}: {dof_text(self.pairs)}"

    def __len__(self) -> int:
        return int(self.node.size)

    def __contains__(self, pair: object) -> bool:
        return pair in self._row

    def row(self, node: int, direction: int, *, owner: str = "the model") -> int:
        """Row of one DOF; raises ModelError that names the DOF and its nearest neighbours."""
        try:
            return self._row[(node, direction)]
        except KeyError:
            raise ModelError(self._missing(node, direction, owner)) from None

    def rows(self, pairs: Sequence[tuple[int, int]], *, owner: str = "the model") -> IntArray:
        """Rows of several DOF, see `row`."""
        return np.array([self.row(n, d, owner=owner) for n, d in pairs], dtype=np.int64)

    def _missing(self, node: int, direction: int, owner: str) -> str:
        here = [d for n, d in self.pairs if n == node]
        if here:
            return f"{owner} has no DOF {node}-{direction}; node {node} has directions {here}"
        return f"{owner} has no node {node} among its DOF." + nearest(str(node), [str(n) for n in self.nodes])
