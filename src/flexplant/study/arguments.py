"""From the command line's words to connections, DOF and patches."""

from __future__ import annotations

from typing import Any

from flexplant.assembly import GROUND, Connection
from flexplant.errors import InputError
from flexplant.study.fields import nodes_of


def parse_connection(text: str) -> Connection:
    """A connection from "a:b:3,11-19" (the same node ids on both sides) or "a:b" (by position), all six directions or, as in
    "a:b:3,11:123" and "a:b::123", those at the end. Raises InputError."""
    a, _, rest = text.partition(":")
    b, *more = rest.split(":")
    nodes, directions = (more + ["", "123456"][len(more) :])[:2]
    if not a or not b or len(more) > 2 or (more and not more[-1]):
        raise InputError(f"connection {text!r}: write a:b:node,node or, to match by position, a:b; add :123 for some directions")
    pairs: Any = [(node, node) for node in _nodes(nodes, text)] if nodes else "by position"
    return Connection(a, b, pairs=pairs, directions=directions)


def parse_ground(text: str) -> Connection:
    """A connection to the ground from "component:3,11". Raises InputError."""
    component, _, nodes = text.partition(":")
    if not component or not nodes:
        raise InputError(f"ground {text!r}: write component:node,node")
    return Connection(component, GROUND, pairs=_nodes(nodes, text), name=f"ground-{component}")


def parse_interface(text: str) -> tuple[str, int]:
    """The connection and the number of its characteristic modes from "a-b=12". Raises InputError."""
    name, _, count = text.rpartition("=")
    if not name or not count.isdecimal():
        raise InputError(f"interface modes {text!r}: write connection=number, such as bus-optic=12")
    return name, int(count)


def parse_boundary(text: str) -> list[tuple[int, str]]:
    """Boundary DOF from "9001,9002:123456 9101:123", groups separated by blanks. Raises InputError."""
    out = []
    for group in text.split():
        nodes, colon, directions = group.partition(":")
        out += [(node, directions if colon else "123456") for node in _nodes(nodes, text)]
    if not out:
        raise InputError("boundary: name nodes and directions, such as '9001,9002:123456 9101:123'")
    return out


def _nodes(text: str, whole: str) -> list[int]:
    try:
        return [node for named in text.split(",") for node in nodes_of(named)]
    except ValueError:
        raise InputError(f"{whole!r}: node ids are whole numbers or ranges 17-40 separated by commas, got {text!r}") from None


def parse_patch(text: str, kind: str) -> dict[str, Any]:
    """An interface node from "9001=101,105-120", in the middle of the patch, or "9001=101,105-120@0.1,0.2,0" at a position;
    "9001=0.03@0.1,0.2,0" takes the nodes within a radius. Raises InputError."""
    node, equals, rest = text.partition("=")
    nodes, at, position = rest.partition("@")
    wrong = InputError(
        f"patch {text!r}: write node=node,node-node, with @x,y,z for another place than the middle of the patch, or "
        "node=radius@x,y,z, metres"
    )
    try:
        where = [float(x) for x in position.split(",")] if at else []
        new: dict[str, Any] = {"node": int(node), "kind": kind} | ({"position_m": where} if at else {})
        found = {"radius_m": float(nodes)} if "." in nodes else {"patch": _nodes(nodes, text)}
    except ValueError:
        raise wrong from None
    if not equals or (at and len(where) != 3) or ("radius_m" in found and not at):
        raise wrong
    return new | found
