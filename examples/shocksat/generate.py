"""Write the Nastran decks of the ShockSat-like surrogate: the whole structure, the bus and the optic.

The structure is a stainless bottom box and an aluminium top box, bolted together at their flanges (the *bus*), and an
aluminium dish on four posts that stand on the roof (the *optic*). Lengths below are inches, as the real article was
drawn; the decks are SI. It is a surrogate, tuned to this mesh and to the MIN4T shell element, not a model of the real
article.

Usage: ``python generate.py [folder]`` (default: ``data`` beside this file).
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from itertools import pairwise
from math import cos, pi, radians, sin, sqrt
from pathlib import Path

INCH = 0.0254  # m
Point = tuple[float, float, float]

# Mesh lines -----------------------------------------------------------------------------------------------------------

PLAN = (-9.0, -7.5, -6.25, -5.0, -2.5, 0.0, 2.5, 5.0, 6.25, 7.5, 9.0)  # x and y lines of floor, roof and walls
FLANGE = (-11.0, -10.0, *PLAN, 10.0, 11.0)  # the flanges reach outward to 11
BOTTOM_Z = [10.0 + 18.0 * i / 8 for i in range(9)]
TOP_Z = [28.6 + 36.4 * i / 20 for i in range(21)]
TOP_RINGS = (4, 8, 12, 16)  # rows of the top box that carry a stiffener ring
BLADE_TIP = 7.75  # inner edge of the 1.25 in blades
DISH_Z = 72.0
POST = 5.625  # the posts stand at (+-POST, +-POST)
DISH_RADII = (1.75, 3.5, 5.25, 2 * POST * sqrt(2) - 9.0, 9.0)  # the outer two rings straddle the post tops
DISH_ANGLES = [radians(7.5 + 15.0 * k) for k in range(24)]
CORNERS = ((1, 1), (-1, 1), (-1, -1), (1, -1))
SIDES = ((1, 0), (0, 1), (-1, 0), (0, -1))  # the wheels' walls
WHEELS, FEET, DISH_CENTER = (9001, 9002, 9003, 9004), (9201, 9202, 9203, 9204), 9101
BOUNDARY = {"bus": (*WHEELS, *FEET), "optic": (DISH_CENTER, *FEET)}  # ascending, as in the component's rows

# Properties -----------------------------------------------------------------------------------------------------------

STEEL_303, AL_6061, BOLT_STEEL = 1, 2, 3
MATERIALS = {  # Young's modulus Pa, Poisson's ratio, density kg/m^3
    STEEL_303: (193e9, 0.29, 8027.17),
    AL_6061: (68.9e9, 0.33, 2712.63),
    BOLT_STEEL: (200e9, 0.30, 7850.0),
}
SHELLS = {  # material, thickness in inches, what it is
    11: (STEEL_303, 0.0785, "bottom walls, y-normal"),
    12: (STEEL_303, 0.25, "bottom flange"),
    13: (STEEL_303, 0.153, "floor"),
    14: (STEEL_303, 0.0625, "bottom stiffener blades"),
    15: (STEEL_303, 0.08321, "bottom walls, x-normal"),
    21: (AL_6061, 0.0586, "top walls, y-normal"),
    22: (AL_6061, 0.25, "top flange"),
    23: (AL_6061, 0.27, "roof"),
    24: (AL_6061, 0.0625, "top stiffener blades"),
    25: (AL_6061, 0.062116, "top walls, x-normal"),
    41: (AL_6061, 0.13, "dish"),
}
BOLT, POST_BAR = 31, 42
BOLT_DIAMETER = 0.375
POST_X, POST_Y = 0.58, 0.93  # solid section

SURROGATE = """\
$ ShockSat-like surrogate. It is tuned to this mesh and to the MIN4T shell element so that its first four free-free
$ flexible modes match the published ones; it is NOT a model of the real article and not a converged one.
$ SI units (m, kg, s, N). Written by generate.py.
"""


def rounded(point: Point) -> Point:
    """A point as `Mesh.ids` looks it up."""
    x, y, z = (round(v, 6) for v in point)
    return x, y, z


@dataclass
class Mesh:
    """Grids (inches) and elements, numbered in the order in which they are made."""

    grids: dict[int, Point] = field(default_factory=dict)
    quads: dict[int, tuple[int, tuple[int, ...]]] = field(default_factory=dict)  # id -> (property, grids)
    bars: dict[int, tuple[int, int, int]] = field(default_factory=dict)  # id -> (property, grid, grid)
    rigids: dict[int, tuple[int, str, tuple[int, ...]]] = field(default_factory=dict)  # id -> (grid, dof, dependents)
    ids: dict[Point, int] = field(default_factory=dict)  # of the part now being meshed
    next_grid: int = 1

    def start_numbering(self, first: int) -> None:
        """Number the grids to come from `first`; they share no grid with what was meshed before."""
        self.next_grid = first
        self.ids = {}

    def grid(self, point: Point) -> int:
        """The grid at a point, made if there is none yet."""
        key = rounded(point)
        if key not in self.ids:
            self.ids[key] = self.add(self.next_grid, point)
            self.next_grid += 1
        return self.ids[key]

    def add(self, number: int, point: Point) -> int:
        self.grids[number] = point
        return number

    def quad(self, prop: int, *corners: Point) -> None:
        self.quads[len(self.quads) + 1] = prop, tuple(self.grid(p) for p in corners)

    def bar(self, prop: int, a: int, b: int) -> None:
        self.bars[10001 + len(self.bars)] = prop, a, b

    def rigid(self, grid: int, directions: str, dependents: Iterable[int]) -> None:
        self.rigids[20001 + len(self.rigids)] = grid, directions, tuple(dependents)


# The boxes ------------------------------------------------------------------------------------------------------------


def perimeter() -> list[tuple[float, float]]:
    """The 40 plan points around a box, counter-clockwise from (-9, -9)."""
    up, down = PLAN[:-1], PLAN[:0:-1]
    edges = [(x, -9.0) for x in up], [(9.0, y) for y in up], [(x, 9.0) for x in down], [(-9.0, y) for y in down]
    return [point for edge in edges for point in edge]


def around() -> list[tuple[tuple[float, float], tuple[float, float]]]:
    """The 40 edges around a box."""
    points = perimeter()
    return list(pairwise([*points, points[0]]))


def walls(mesh: Mesh, levels: list[float], y_normal: int, x_normal: int) -> None:
    for low, high in pairwise(levels):
        for a, b in around():
            prop = y_normal if a[1] == b[1] else x_normal
            mesh.quad(prop, (*a, low), (*b, low), (*b, high), (*a, high))


def plate(mesh: Mesh, prop: int, lines: tuple[float, ...], z: float, hole: float = 0.0) -> None:
    """A horizontal plate on plan lines, with a square hole of half-width `hole`."""
    for x0, x1 in pairwise(lines):
        for y0, y1 in pairwise(lines):
            if max(abs(x0 + x1), abs(y0 + y1)) / 2 >= hole:
                mesh.quad(prop, (x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z))


def inner(point: tuple[float, float]) -> tuple[float, float]:
    """The blade's inner edge opposite a wall point."""
    x, y = (max(-BLADE_TIP, min(BLADE_TIP, v)) for v in point)
    return x, y


def ring(mesh: Mesh, prop: int, z: float) -> None:
    for a, b in around():
        mesh.quad(prop, (*a, z), (*b, z), (*inner(b), z), (*inner(a), z))


def stringers(mesh: Mesh, prop: int, levels: list[float]) -> None:
    """A vertical blade in the middle of each of the four walls."""
    for side in ((0.0, -9.0), (9.0, 0.0), (0.0, 9.0), (-9.0, 0.0)):
        for low, high in pairwise(levels):
            mesh.quad(prop, (*side, low), (*inner(side), low), (*inner(side), high), (*side, high))


def bottom_box(mesh: Mesh) -> None:
    mesh.start_numbering(1001)
    walls(mesh, BOTTOM_Z, 11, 15)
    plate(mesh, 13, PLAN, 10.0)
    plate(mesh, 12, FLANGE, 28.0, hole=9.0)
    ring(mesh, 14, 19.0)
    stringers(mesh, 14, BOTTOM_Z)


def top_box(mesh: Mesh) -> None:
    mesh.start_numbering(3001)
    walls(mesh, TOP_Z, 21, 25)
    plate(mesh, 23, PLAN, 65.0)
    plate(mesh, 22, FLANGE, 28.6, hole=9.0)
    for row in TOP_RINGS:
        ring(mesh, 24, TOP_Z[row])
    stringers(mesh, 24, TOP_Z)


def bolts(mesh: Mesh, bottom: dict[Point, int], top: dict[Point, int]) -> None:
    """28 bolts between the flanges."""
    for v in (-7.5, -5.0, -2.5, 0.0, 2.5, 5.0, 7.5):
        for x, y in ((v, -10.0), (v, 10.0), (-10.0, v), (10.0, v)):
            mesh.bar(BOLT, bottom[x, y, BOTTOM_Z[-1]], top[x, y, TOP_Z[0]])


def wheels(mesh: Mesh, bottom: dict[Point, int]) -> None:
    """Four wheel grids, each carried by four grids of the wall outboard of it."""
    for number, (x, y) in zip(WHEELS, SIDES, strict=True):
        mesh.add(number, (6.0 * x, 6.0 * y, 19.0))
        offsets = (2.5, 0.0), (-2.5, 0.0), (0.0, -2.25), (0.0, 2.25)  # along the wall, up
        wall = [(9.0 * x - s * y, 9.0 * y + s * x, 19.0 + up) for s, up in offsets]
        mesh.rigid(number, "123", (bottom[p] for p in wall))


def interface(mesh: Mesh, top: dict[Point, int]) -> None:
    """Four grids at the feet of the posts, each carried by the roof cell around it."""
    for number, (x, y) in zip(FEET, CORNERS, strict=True):
        mesh.add(number, (POST * x, POST * y, 65.0))
        cell = (5.0, 5.0), (6.25, 5.0), (6.25, 6.25), (5.0, 6.25)
        mesh.rigid(number, "123", (top[a * x, b * y, 65.0] for a, b in cell))


# The optic ------------------------------------------------------------------------------------------------------------


def dish_point(radius: float, sector: int) -> Point:
    angle = DISH_ANGLES[sector % 24]
    return radius * cos(angle), radius * sin(angle), DISH_Z


def dish(mesh: Mesh) -> None:
    mesh.start_numbering(5001)
    for r0, r1 in pairwise(DISH_RADII):
        for k in range(24):
            mesh.quad(41, dish_point(r0, k), dish_point(r1, k), dish_point(r1, k + 1), dish_point(r0, k + 1))


def posts(mesh: Mesh) -> None:
    mesh.start_numbering(5501)
    for foot, (x, y) in zip(FEET, CORNERS, strict=True):
        column = [foot] + [mesh.grid((POST * x, POST * y, 65.0 + 7.0 * i / 4)) for i in range(1, 5)]
        for a, b in pairwise(column):
            mesh.bar(POST_BAR, a, b)


def dish_supports(mesh: Mesh, dish_ids: dict[Point, int]) -> None:
    """The inner ring hangs on the dish centre; each post top carries the dish cell around it."""

    def at(radius: float, sector: int) -> int:
        return dish_ids[rounded(dish_point(radius, sector))]

    mesh.add(DISH_CENTER, (0.0, 0.0, DISH_Z))
    mesh.rigid(DISH_CENTER, "123456", (at(DISH_RADII[0], k) for k in range(24)))
    inside, outside = DISH_RADII[3:]
    for top, k in zip((5504, 5508, 5512, 5516), (2, 8, 14, 20), strict=True):
        mesh.rigid(top, "123", (at(inside, k), at(outside, k), at(outside, k + 1), at(inside, k + 1)))


def whole() -> Mesh:
    """The whole structure, bus and optic."""
    mesh = Mesh()
    bottom_box(mesh)
    bottom = mesh.ids
    top_box(mesh)
    top = mesh.ids
    dish(mesh)
    dish_ids = mesh.ids
    bolts(mesh, bottom, top)
    posts(mesh)
    wheels(mesh, bottom)
    interface(mesh, top)
    dish_supports(mesh, dish_ids)
    return mesh


def part(mesh: Mesh, keep: Callable[[int], bool]) -> Mesh:
    """The part of a mesh whose grids `keep` accepts, with the elements that lie wholly in it."""

    def inside(*grids: int) -> bool:
        return all(keep(g) for g in grids)

    return Mesh(
        grids={g: p for g, p in mesh.grids.items() if keep(g)},
        quads={e: q for e, q in mesh.quads.items() if inside(*q[1])},
        bars={e: b for e, b in mesh.bars.items() if inside(*b[1:])},
        rigids={e: r for e, r in mesh.rigids.items() if inside(r[0], *r[2])},
    )


def in_bus(grid: int) -> bool:
    return grid < 5000 or grid in BOUNDARY["bus"]


def in_optic(grid: int) -> bool:
    return 5000 < grid < 6000 or grid in BOUNDARY["optic"]


# Cards ----------------------------------------------------------------------------------------------------------------


def grid_card(number: int, point: Point) -> str:
    """A large-field card: 16 characters a coordinate, so nothing is truncated."""
    x, y, z = (f"{v * INCH:16.12f}" for v in point)
    return f"{'GRID*':<8}{number:16d}{'':16}{x}{y}\n{'*':<8}{z}"


def rigid_card(number: int, grid: int, directions: str, dependents: tuple[int, ...]) -> str:
    fields = [str(number), str(grid), directions, *map(str, dependents)]
    rows = [",".join(fields[i : i + 8]) for i in range(0, len(fields), 8)]
    return "RBE2," + "\n,".join(rows)


def mass_card() -> str:
    """The lumped optics at the dish centre: 0.8 kg and a small inertia about each axis."""
    return f"CONM2,30001,{DISH_CENTER},,0.8\n,6.322568e-4,,6.322568e-4,,,6.322568e-4"


def shell_card(number: int) -> str:
    material, thickness, name = SHELLS[number]
    return f"$ {name}\nPSHELL,{number},{material},{thickness * INCH:.9f},{material},,{material}"


def bolt_card() -> str:
    """Round, without torsion (the shells have no drilling stiffness to react it)."""
    d = BOLT_DIAMETER * INCH
    area, inertia = pi * d**2 / 4, pi * d**4 / 64
    return f"$ flange bolt\nPBAR,{BOLT},{BOLT_STEEL},{area:.8e},{inertia:.8e},{inertia:.8e},0."


def post_card() -> str:
    """Solid rectangle; I1 bends in the x-z plane, torsion by Roark's formula."""
    a, b = POST_X * INCH, POST_Y * INCH
    torsion = a**3 * b * (1 / 3 - 0.21 * a / b * (1 - (a / b) ** 4 / 12))
    return f"$ post\nPBAR,{POST_BAR},{AL_6061},{a * b:.8e},{a**3 * b / 12:.8e},{a * b**3 / 12:.8e},{torsion:.8e}"


def property_cards(mesh: Mesh) -> list[str]:
    """The shell and bar properties that the mesh uses, and all materials."""
    shells = [shell_card(p) for p in sorted({prop for prop, _ in mesh.quads.values()})]
    used = {prop for prop, _, _ in mesh.bars.values()}
    bars = [card() for prop, card in ((BOLT, bolt_card), (POST_BAR, post_card)) if prop in used]
    materials = [f"MAT1,{m},{e:.6e},,{nu},{rho}" for m, (e, nu, rho) in MATERIALS.items()]
    return shells + bars + materials


def bulk(mesh: Mesh) -> list[str]:
    """The bulk data of a mesh, without its parameters and eigenvalue method."""
    quads = [f"CQUAD4,{e},{p}," + ",".join(map(str, g)) for e, (p, g) in mesh.quads.items()]
    bars = [f"CBAR,{e},{p},{a},{b},1.,0.,0." for e, (p, a, b) in mesh.bars.items()]  # orientation +x
    rigids = [rigid_card(e, *r) for e, r in mesh.rigids.items()]
    masses = [mass_card()] if DISH_CENTER in mesh.grids else []
    grids = [grid_card(g, mesh.grids[g]) for g in sorted(mesh.grids)]
    return grids + quads + bars + rigids + masses + property_cards(mesh)


PARAMETERS = ["PARAM,K6ROT,0.", "PARAM,QUAD4TYP,MIN4T", "PARAM,GRIDSEQ,GRID", "PARAM,GRDPNT,0", "PARAM,PRTDOF,1"]


def modes_deck(mesh: Mesh, title: str, n_modes: int) -> str:
    """SOL 103: free-free modes, with shapes at all grids."""
    head = ["ID SHOCKSAT,WHOLE", "SOL 103", "OUTPUT4 EIGEN_VEC,EIGEN_VAL,,,//-1/21", "CEND"]
    case = [f"TITLE = {title}", "METHOD = 1", "BEGIN BULK"]
    method = [f"EIGRL,1,,,{n_modes},,,,MASS"]
    return SURROGATE + "\n".join([*head, *case, *PARAMETERS, *method, *bulk(mesh), "ENDDATA", ""])


def craig_bampton_deck(mesh: Mesh, part_name: str, n_modes: int) -> str:
    """SOL 31: Craig-Bampton model; the boundary is what SUPORT names."""
    name, boundary = part_name.upper(), BOUNDARY[part_name]
    head = [f"ID SHOCKSAT,{name}", "SOL 31", "OUTPUT4 KXX,MXX,,,//-1/21", "OUTPUT4 PHIXG,,,,//-1/22", "CEND"]
    case = [f"TITLE = SHOCKSAT SURROGATE, {name}, CRAIG-BAMPTON, SI", "METHOD = 1", "BEGIN BULK"]
    method = [f"EIGRL,1,,,{n_modes},,,,MASS", *(f"SUPORT,{g},123456" for g in boundary)]
    return SURROGATE + "\n".join([*head, *case, *PARAMETERS, *method, *bulk(mesh), "ENDDATA", ""])


WHOLE_MODES, BUS_MODES, OPTIC_MODES = 180, 360, 30


def decks() -> dict[str, str]:
    """All decks, by name."""
    mesh = whole()
    bus, optic = part(mesh, in_bus), part(mesh, in_optic)
    return {
        "whole": modes_deck(mesh, "SHOCKSAT SURROGATE, WHOLE, FREE-FREE, SI", WHOLE_MODES),
        "bus": craig_bampton_deck(bus, "bus", BUS_MODES),
        "optic": craig_bampton_deck(optic, "optic", OPTIC_MODES),
    }


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "data"
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in decks().items():
        (folder / f"{name}.bdf").write_text(text)
        print(f"{folder / name}.bdf: {len(text)} bytes")


if __name__ == "__main__":
    main()
