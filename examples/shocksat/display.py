"""The display recovery matrices: few enough grids to animate, enough to see panels and global modes.

A stored ``*_display.npz`` holds

- ``nodes`` (n): grid ids; ``positions`` (n, 3): metres;
- ``matrix`` (3n, b + q) float32: translations x, y, z of each node in turn, ``u = matrix @ p``, with the component's
  coordinates ``p`` in the order of KXX (boundary by ascending grid, then modes);
- ``quads`` (m, 4), ``lines`` (k, 2): faces and edges to draw, as places in ``nodes``.
"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import generate as g
import numpy as np
from mystran_files import read_grids, read_quads

COARSE = (-9.0, -5.0, 0.0, 5.0, 9.0)  # plan lines shown: edges, panel middles, stringers
BOTTOM_ROWS = (0, 2, 6, 8)  # edges and panel middles; the rings between them hardly move
TOP_ROWS = (0, 2, 6, 10, 14, 18, 20)

Face = tuple[g.Point, ...]


def coarse_edges() -> list[tuple[tuple[float, float], tuple[float, float]]]:
    """The edges around a box on the coarse plan lines."""
    points = [p for p in g.perimeter() if set(p) <= set(COARSE)]
    return list(pairwise([*points, points[0]]))


def wall_faces(levels: list[float]) -> list[Face]:
    return [((*a, low), (*b, low), (*b, high), (*a, high)) for low, high in pairwise(levels) for a, b in coarse_edges()]


def plate_faces(z: float) -> list[Face]:
    cells = [(x, y) for x in pairwise(COARSE) for y in pairwise(COARSE)]
    return [((x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)) for (x0, x1), (y0, y1) in cells]


def flange_faces(z: float) -> list[Face]:
    def outward(point: tuple[float, float]) -> g.Point:
        x, y = (11.0 * np.sign(v) if abs(v) == 9 else v for v in point)
        return x, y, z

    return [((*a, z), outward(a), outward(b), (*b, z)) for a, b in coarse_edges()]


def bus_faces() -> tuple[list[Face], list[Face]]:
    """Faces of the bottom box and of the top box."""
    bottom = wall_faces([g.BOTTOM_Z[row] for row in BOTTOM_ROWS]) + plate_faces(10.0) + flange_faces(28.0)
    return bottom, wall_faces([g.TOP_Z[row] for row in TOP_ROWS]) + plate_faces(65.0)


def bus_outline() -> tuple[list[tuple[int, ...]], list[tuple[int, int]]]:
    """Faces of the bus, and lines from the wheels to their walls and from the posts' feet to the roof, in grid ids."""
    mesh = g.Mesh()
    g.bottom_box(mesh)
    bottom = mesh.ids
    g.top_box(mesh)
    lower, upper = bus_faces()
    faces = [tuple(bottom[g.rounded(p)] for p in face) for face in lower]
    faces += [tuple(mesh.ids[g.rounded(p)] for p in face) for face in upper]
    lines = [(foot, mesh.ids[5.0 * x, 5.0 * y, 65.0]) for foot, (x, y) in zip(g.FEET, g.CORNERS, strict=True)]
    for wheel, (x, y) in zip(g.WHEELS, g.SIDES, strict=True):
        lines += [(wheel, bottom[g.rounded((9.0 * x, 9.0 * y, g.BOTTOM_Z[row]))]) for row in (2, 6)]
    return faces, lines


def optic_outline(deck: Path) -> tuple[list[tuple[int, ...]], list[tuple[int, int]]]:
    """Faces of the dish, and lines of the posts and of four spokes to the dish centre, in grid ids."""
    faces = [card[1:] for card in read_quads(deck).values()]
    inner_ring = [face[0] for face in faces[:24]]
    posts = [(5501 + 4 * i, foot) for i, foot in enumerate(g.FEET)]
    shafts = [edge for first, _ in posts for edge in pairwise(range(first, first + 4))]
    return faces, posts + shafts + [(g.DISH_CENTER, grid) for grid in inner_ring[::6]]


def edges(faces: list[tuple[int, ...]]) -> set[tuple[int, int]]:
    """Every edge of the faces, once."""
    return {(min(e), max(e)) for face in faces for e in pairwise((*face, face[0]))}


def store(path: Path, deck: Path, name: str, shapes: np.ndarray) -> None:
    """Store a component's display set; `shapes` gives all six G-set displacements per component coordinate."""
    faces, lines = bus_outline() if name == "bus" else optic_outline(deck)
    grids = read_grids(deck)
    every = sorted(edges(faces)) + lines
    nodes = np.unique([grid for part in (*faces, *every) for grid in part]).astype("i4")
    first = 6 * np.searchsorted(sorted(grids), nodes)
    rows = (first[:, None] + np.arange(3)).ravel()
    np.savez_compressed(
        path,
        nodes=nodes,
        positions=np.array([grids[n] for n in nodes]),
        matrix=shapes[rows].astype("f4"),
        quads=np.searchsorted(nodes, faces).astype("i4"),
        lines=np.searchsorted(nodes, every).astype("i4"),
    )
