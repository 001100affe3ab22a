"""Nastran coordinate systems (CORD1/CORD2, rectangular, cylindrical, spherical) and grid points."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from flexplant.errors import ReadError
from flexplant.io.parse.bulk import Card
from flexplant.model.arrays import FloatArray
from flexplant.model.geometry import Nodes, cylindrical_frame

GRID_FIELDS = range(1, 6)  # CP, position, CD
SYSTEM_CARDS = {f"CORD{n}{kind}": kind for n in "12" for kind in "RCS"}


@dataclass(frozen=True)
class CoordinateSystem:
    """kind R, C or S; origin (3,) and axes (3, 3; rows x, y, z), in the basic frame."""

    kind: str
    origin: FloatArray
    axes: FloatArray

    def to_basic(self, values: FloatArray) -> FloatArray:
        """Basic position of a point given by (x, y, z), (r, theta, z) or (r, theta, phi), angles in degrees."""
        a, b, c = values
        if self.kind == "C":
            values = np.array([a * np.cos(np.deg2rad(b)), a * np.sin(np.deg2rad(b)), c])
        elif self.kind == "S":
            theta, phi = np.deg2rad(b), np.deg2rad(c)
            values = a * np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])
        return np.asarray(self.origin + self.axes.T @ values)

    def frame_at(self, position: FloatArray) -> FloatArray:
        """Displacement axes (rows) at a basic position."""
        if self.kind == "R":
            return self.axes
        around = cylindrical_frame(position, self.origin, self.axes)
        if self.kind == "C":
            return around
        local = around @ (position - self.origin)  # radial in the plane, 0, height
        polar = np.arctan2(local[0], local[2])
        radial = np.sin(polar) * around[0] + np.cos(polar) * around[2]
        down = np.cos(polar) * around[0] - np.sin(polar) * around[2]
        return np.array([radial, down, around[1]])


BASIC = CoordinateSystem("R", np.zeros(3), np.eye(3))


@dataclass
class Geometry:
    """Grids and coordinate systems of some cards, resolved on demand; of several files the first card of an id counts."""

    path: Path = Path()
    systems: dict[int, tuple[Card, int]] = field(default_factory=dict)
    grids: dict[int, Card] = field(default_factory=dict)
    scalars: list[int] = field(default_factory=list)
    _resolved: dict[int, CoordinateSystem] = field(default_factory=lambda: {0: BASIC})
    _placed: dict[int, FloatArray] = field(default_factory=dict)
    _open: list[str] = field(default_factory=list)

    @classmethod
    def of(cls, cards: Iterable[Card], *, one_deck: bool = False) -> Geometry:
        """From the GRID, SPOINT and CORD cards among these; one_deck: their files are parts of one, with INCLUDE.

        Raises ReadError for an id below 1, and for one that a file (or the deck) has twice with other numbers, as Nastran does.
        """
        out = cls()
        scalars: dict[int, None] = {}
        for card in cards:
            out.path = card.path
            if card.name == "GRID":
                _agree(card, out.grids.setdefault(_id(card, 0), card), GRID_FIELDS, one_deck)
            elif card.name == "SPOINT":
                scalars.update(dict.fromkeys(card.ids()))
            elif card.name in SYSTEM_CARDS:
                starts, size = ((0, 4), 4) if card.name[4] == "1" else ((0,), 11)
                for start in starts:
                    if card.text(start):
                        first, at = out.systems.setdefault(_id(card, start), (card, start))
                        _agree(card, first, range(start, start + size) if start == at else (), one_deck)
        out.scalars = list(scalars)
        return out

    def position(self, grid: int, owner: Card | None = None) -> FloatArray:
        """(3,) basic position of a grid."""
        if grid not in self._placed:
            if grid not in self.grids:
                raise self._missing(f"grid {grid}", owner)
            card = self.grids[grid]
            self._enter(f"grid {grid}", card)
            given = np.array([card.real(i) for i in (2, 3, 4)])
            self._placed[grid] = self.system(card.integer(1, 0), card).to_basic(given)
            self._open.pop()
        return self._placed[grid]

    def frame(self, grid: int) -> FloatArray:
        """(3, 3) displacement axes (rows) of a grid, from its field CD."""
        position, card = self.position(grid), self.grids[grid]
        number = card.integer(5, 0)
        return np.eye(3) if number == -1 else self.system(number, card).frame_at(position)

    def system(self, number: int, owner: Card) -> CoordinateSystem:
        """A coordinate system by its number; ReadError if it is not defined or defined by itself."""
        if number not in self._resolved:
            if number not in self.systems:
                raise self._missing(f"coordinate system {number}", owner)
            card, start = self.systems[number]
            self._enter(f"coordinate system {number}", card)
            self._resolved[number] = _from_points(card, *self._points(card, start))
            self._open.pop()
        return self._resolved[number]

    def _points(self, card: Card, start: int) -> Any:
        if card.name[4] == "1":
            return [self.position(card.integer(start + i), card) for i in (1, 2, 3)]
        reference = self.system(card.integer(1, 0), card)
        return [reference.to_basic(np.array([card.real(i) for i in range(at, at + 3)])) for at in (2, 5, 8)]

    def _enter(self, what: str, card: Card) -> None:
        if what in self._open or len(self._open) > 200:
            raise card.fail(f"is defined by itself: {' -> '.join(self._open[-5:])} -> {what}")
        self._open.append(what)

    def _missing(self, what: str, owner: Card | None) -> ReadError:
        return owner.fail(f"refers to {what}, which is not in the file") if owner else ReadError(self.path, f"has no {what}")

    def nodes(self, ids: Iterable[int] | None = None) -> Nodes:
        """Positions and displacement frames of these grids (all of them if None), ascending."""
        ids = sorted(self.grids if ids is None else ids)
        frames = np.array([self.frame(i) for i in ids]).reshape(-1, 3, 3)
        positions = np.array([self.position(i) for i in ids]).reshape(-1, 3)
        plain = bool((frames == np.eye(3)).all())
        return Nodes(ids=np.array(ids, dtype=np.int64), positions=positions, frames=None if plain else frames)


def _id(card: Card, index: int) -> int:
    found = card.integer(index)
    if found < 1:
        raise card.fail(f"has id {found}; ids are 1 and above")
    return found


def _agree(card: Card, first: Card, fields: Iterable[int], one_deck: bool) -> None:
    """ReadError where two cards of one id have other numbers (the first may stand in another file than the deck's)."""
    if card is first or not (one_deck or card.path == first.path):
        return
    if card.name != first.name or any(card.real(i) != first.real(i) for i in fields):
        before = f"line {first.line}" + ("" if card.path == first.path else f" of {first.path.name}")
        raise card.fail(f"{card.text(0)} is there already with other numbers ({before}); remove one of the two")


def _from_points(card: Card, a: FloatArray, b: FloatArray, c: FloatArray) -> CoordinateSystem:
    """Origin A, z axis towards B, C in the x-z plane."""
    z, across = b - a, c - a
    y = np.cross(z, across)
    if not (np.isfinite(y).all() and np.linalg.norm(y) > 1e-10 * np.linalg.norm(z) * np.linalg.norm(across)):
        raise card.fail("has its three points on one line")
    z, y = z / np.linalg.norm(z), y / np.linalg.norm(y)
    return CoordinateSystem(SYSTEM_CARDS[card.name], a, np.array([np.cross(y, z), y, z]))
