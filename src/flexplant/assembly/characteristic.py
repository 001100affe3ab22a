"""Characteristic constraint modes of an assembled interface, shared by both its sides."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from flexplant.assembly.connection import GROUND, Connection
from flexplant.assembly.constraints import Resolved, Row
from flexplant.assembly.couple import assembled
from flexplant.assembly.system import System, component_rigid_body
from flexplant.errors import InputError, nearest
from flexplant.model.arrays import FloatArray, IntArray, dense, is_number
from flexplant.model.component import Component
from flexplant.model.coordinates import LeftOut, in_coordinates
from flexplant.model.dofs import DofSet
from flexplant.model.geometry import Nodes
from flexplant.numerics.eigen import dense_eigenpairs
from flexplant.numerics.elimination import eliminate

FLOATING = 1e-10  # of the largest w^2: below it an interface mode is rigid motion, of which nothing may be left out
EXPLAINED = 1e-8  # part of unit rigid motions that the interface may lack, and from which they are independent
SIDES = 2**0.5  # |x + y|^2 <= 2 |x|^2 + 2 |y|^2: each side answers for the residual that both have in a motion left out
NEW = 1e-10  # singular values of static shapes below which they are combinations of others


def characteristic_interface(
    system: System, connection: str, *, n_modes: int | None = None, max_frequency_hz: float | None = None
) -> System:
    """The system with the interface of one rigid connection described by few coordinates eta that both sides share.

        u_a = N_a W eta,  u_b = N_b W eta,   W = [Phi, W_s],   N^T K N Phi = N^T M N Phi diag(w^2)

    N spans what the connection admits of both sides' interface DOF (their frames and offsets included), K and M are those of
    the assembled interface, all other boundary DOF held; Phi (m, n_c) are its first `n_modes` modes, or those up to
    `max_frequency_hz`. W_s are the static shapes in which unit motions of the other boundary DOF move it and that Phi lacks,
    so statics stay exact; kept whole, Phi only changes coordinates. In both components eta replaces the interface DOF,
    coupled one to one and everything else keeps its name, modal coordinates too. eta are the six rigid motions of the
    interface, DOF of a new node in its middle that has the same id on both sides, and scalar boundary DOF for the other
    shapes of the same span. Without positions (or where they do not explain the interface) all eta are scalar, and the two
    components come back without nodes.

    Raises InputError for an unknown, compliant or grounded connection, interface DOF that other connections use, fewer modes
    than the interface has rigid motions, and impossible numbers. Source: Castanier, Tan and Pierre 2001.
    """
    if not isinstance(system, System):
        raise InputError(f"characteristic_interface takes a coupled System, got {type(system).__name__}")
    _check_request(n_modes, max_frequency_hz)
    joint = _joint(system, connection)
    sides = [_interface_rows(system, joint, name) for name in (joint.connection.a, joint.connection.b)]
    shapes, lost, slowest, center = _shapes(system, joint, sides, n_modes, max_frequency_hz)
    first = 1 + max(_highest_id(c) for c in system.components)
    dofs = [] if center is None else [(first, d) for d in range(1, 7)]
    dofs += [(first + 1 + i, 0) for i in range(shapes.shape[1] - len(dofs))]
    a, b, n_a = joint.connection.a, joint.connection.b, sides[0].size
    parts = {c.name: c for c in system.components}
    for name, rows, part in zip((a, b), sides, (slice(n_a), slice(n_a, None)), strict=True):
        nodes = None if center is None else _with_node(system, name, first, center)
        parts[name] = _replaced(parts[name], rows, shapes[part], lost[part], slowest, dofs, nodes)
    tie = str(joint.connection.name)
    ties = [Row(f"{tie}.{i}.{d}", tie, {(a, i, d): 1.0, (b, i, d): -1.0}, geometric=False) for i, d in dofs]
    shared = Connection(a, b, pairs=[(dof, dof) for dof in dofs], name=tie)
    others = [Resolved(shared, [], ties) if r is joint else r for r in system.connections]
    return assembled(tuple(parts.values()), system.placements, others, system.method)


def _highest_id(component: Component) -> int:
    """The highest node id in use, also of nodes that no DOF of the component moves."""
    known = component.dofs.node, component.interior.node, () if component.nodes is None else component.nodes.ids
    return max(int(np.max(ids, initial=0)) for ids in known)


def _check_request(n_modes: int | None, max_frequency_hz: float | None) -> None:
    if (n_modes is None) == (max_frequency_hz is None):
        raise InputError("characteristic_interface: give n_modes or max_frequency_hz")
    if n_modes is not None and not (isinstance(n_modes, (int, np.integer)) and not isinstance(n_modes, bool) and n_modes > 0):
        raise InputError(f"characteristic_interface: n_modes must be a positive whole number, got {n_modes!r}")
    if max_frequency_hz is not None and not (is_number(max_frequency_hz) and max_frequency_hz > 0):
        raise InputError(f"characteristic_interface: max_frequency_hz must be positive, got {max_frequency_hz!r}")


def _joint(system: System, name: str) -> Resolved:
    """The connection, if it can be described so."""
    found = {str(r.connection.name): r for r in system.connections}
    if not isinstance(name, str) or name not in found:
        raise InputError(f"characteristic_interface: there is no connection {name!r:.60}." + nearest(name, found))
    joint = found[name]
    if joint.connection.b == GROUND or not joint.connection.rigid or joint.connection.a == joint.connection.b:
        raise InputError(f"characteristic_interface: connection {name!r} must tie two components rigidly")
    own = {dof for row in joint.rows for dof in row.terms}
    for other in system.connections:
        shared = sorted(dof for row in other.rows for dof in row.terms if other is not joint and dof in own)
        if shared:
            text = ".".join(map(str, shared[0]))
            raise InputError(f"characteristic_interface: connection {other.connection.name!r} uses {text} of {name!r} too")
    return joint


def _interface_rows(system: System, joint: Resolved, name: str) -> IntArray:
    """Rows of one component's coordinates that the connection couples, ascending."""
    component = system.component(name)
    dofs = {dof[1:] for row in joint.rows for dof in row.terms if dof[0] == name}
    return np.sort(component.dofs.rows(sorted(dofs), owner=f"component {name!r}"))


def _shapes(
    system: System, joint: Resolved, sides: list[IntArray], n_modes: int | None, max_frequency_hz: float | None
) -> tuple[FloatArray, FloatArray, float, FloatArray | None]:
    """N W (n_a + n_b, m): interface DOF of both sides in the shared shapes; N X of what these leave out, X^T K X = I and
    X^T K W = 0, and the lowest w^2 of X; the point that the first six shapes turn about."""
    a, b = (system.component(name) for name in (joint.connection.a, joint.connection.b))
    admitted = _admitted(joint, [(a, sides[0]), (b, sides[1])])
    k, m = (_interface(matrices, sides) for matrices in ((a.stiffness, b.stiffness), (a.mass, b.mass)))
    found = dense_eigenpairs(admitted.T @ k @ admitted, admitted.T @ m @ admitted, np.zeros((admitted.shape[1], 0)))
    limit = np.inf if max_frequency_hz is None else (2 * np.pi * max_frequency_hz) ** 2
    kept = int(np.count_nonzero(found.omega2 <= limit)) if n_modes is None else n_modes
    least = int(np.count_nonzero(found.omega2 <= FLOATING * found.omega2.max(initial=0.0)))
    if not least <= kept <= found.omega2.size or not kept:
        raise InputError(
            f"characteristic_interface: {kept} modes of {joint.connection.name!r} asked; its {admitted.shape[1]} DOF have "
            f"{found.omega2.size}, of which at least {max(least, 1)} are needed"
        )
    omega = np.sqrt(found.omega2[kept:])
    rest = found.vectors[:, kept:] / omega
    held = [np.setdiff1d(np.arange(c.n_boundary), rows) for c, rows in ((a, sides[0]), (b, sides[1]))]
    pull = la.block_diag(*(dense(c.stiffness)[np.ix_(r, h)] for c, r, h in zip((a, b), sides, held, strict=True)))
    static = rest @ _span(rest.T @ (admitted.T @ pull))
    shapes = np.hstack([found.vectors[:, :kept], static])
    known, inside = _rigid(system, [(a, sides[0]), (b, sides[1])], admitted), admitted.T @ m @ admitted
    if known is not None:
        rigid = known[0]
        other = shapes - rigid @ la.solve(rigid.T @ inside @ rigid, rigid.T @ inside @ shapes, assume_a="pos")
        shapes = np.hstack([rigid, _span(other)])
    weighted = inside @ shapes
    share = rest.T @ weighted / np.sqrt(np.einsum("ij,ij->j", shapes, weighted))
    lost = rest @ la.null_space((omega[:, None] ** 2 * share).T, rcond=NEW)  # rest^T K rest = I, so this is K-orthogonal
    slowest = 1 / la.eigvalsh(lost.T @ inside @ lost)[-1] if lost.shape[1] else np.inf
    return np.asarray(admitted @ shapes), np.asarray(admitted @ lost), float(slowest), None if known is None else known[1]


def _rigid(system: System, sides: list[tuple[Component, IntArray]], admitted: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Combinations (m, 6) of N that are the rigid motions about the interface's middle, and that point; None where unknown."""
    if any(c.nodes is None for c, _ in sides):
        return None
    component, rows = sides[0]
    assert component.nodes is not None
    held = {int(component.boundary.node[i]) for i in rows}
    center = np.mean([system.placement(component.name).apply(component.nodes.position(n)) for n in held], axis=0)
    motion = np.vstack([component_rigid_body(c, system.placement(c.name), center)[r] for c, r in sides])
    size = np.maximum(np.linalg.norm(motion, axis=0), np.finfo(float).tiny)
    found = la.lstsq(admitted, motion / size)[0]
    explained = np.linalg.norm(admitted @ found - motion / size) < EXPLAINED
    return (found * size, center) if explained and np.linalg.matrix_rank(found, tol=EXPLAINED) == 6 else None


def _with_node(system: System, name: str, node: int, center: FloatArray) -> Nodes:
    """The component's nodes, and one at `center` with the system's axes."""
    nodes, placement = system.component(name).nodes, system.placement(name)
    assert nodes is not None
    position = placement.rotation.T @ (center - placement.translation)
    frames = np.array([nodes.frame(int(i)) for i in nodes.ids] + [placement.rotation])
    return Nodes(ids=np.r_[nodes.ids, node], positions=np.vstack([nodes.positions, position]), frames=frames)


def _span(columns: FloatArray) -> FloatArray:
    """Orthonormal basis of what columns of any size span."""
    size = np.linalg.norm(columns, axis=0)
    live = size > NEW * size.max(initial=0.0)
    return la.orth(columns[:, live] / size[live], rcond=NEW) if live.any() else columns[:, :0]


def _admitted(joint: Resolved, sides: list[tuple[Component, IntArray]]) -> FloatArray:
    """N (n_a + n_b, m): motions of the interface DOF that satisfy the connection's rows."""
    place: dict[tuple[str, int, int], int] = {}
    for component, rows in sides:
        for row in rows:
            node, direction = component.dofs.pairs[row]
            place[(component.name, node, direction)] = len(place)
    matrix = np.zeros((len(joint.rows), len(place)))
    for i, row in enumerate(joint.rows):
        for dof, value in row.terms.items():
            matrix[i, place[dof]] = value
    return np.asarray(eliminate(sp.csr_array(matrix)).basis.toarray())


def _interface(matrices: tuple[object, object], sides: list[IntArray]) -> FloatArray:
    return np.asarray(la.block_diag(*(dense(m)[np.ix_(r, r)] for m, r in zip(matrices, sides, strict=True))))


def _replaced(
    component: Component, rows: IntArray, shapes: FloatArray, lost: FloatArray, slowest: float, dofs: list[tuple[int, int]],
    nodes: Nodes | None,
) -> Component:  # fmt: skip
    """The component with its interface DOF `rows` in `shapes` (n_r, m): boundary = what is left of it, then eta. lost: (n_r, k)
    motions of both sides that are left out, none slower than w^2 = `slowest`."""
    n, n_b, m = component.n, component.n_boundary, shapes.shape[1]
    held = np.setdiff1d(np.arange(n_b), rows)
    basis = np.zeros((n, held.size + m + n - n_b))
    basis[held, np.arange(held.size)] = 1.0
    basis[rows, held.size : held.size + m] = shapes
    basis[n_b:, held.size + m :] = np.eye(n - n_b)
    mass = dense(component.mass)[rows]
    left_out = LeftOut(rows=SIDES * lost.T @ (mass @ basis), slowest=slowest, interface=(rows.size, m))
    boundary = DofSet.of([component.boundary.pairs[i] for i in held] + dofs)
    return in_coordinates(component, basis, left_out, boundary=boundary, nodes=nodes, modal_ids=component.modal_ids)
