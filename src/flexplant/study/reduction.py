"""Reducing a model as a study or the command line asks: patches become nodes, a method reduces, interfaces become small."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from flexplant.errors import InputError, ModelError, SolverError, nearest
from flexplant.model.arrays import FloatArray
from flexplant.model.component import Component, FiniteElementModel
from flexplant.model.damping import DampingRatio, with_modal_damping
from flexplant.reduction import characteristic_constraint_modes, craig_bampton, guyan, rubin, with_interface_node

METHODS: dict[str, Callable[..., Component]] = {"craig_bampton": craig_bampton, "rubin": rubin, "guyan": guyan}
OPTIONS = ("max_frequency_hz", "n_modes", "residual_vectors", "accuracy", "size", "loads", "recover", "keep_basis")
Rows = Iterable[tuple[int, int | str]]


def foreign_option(method: str, options: Iterable[str]) -> str | None:
    """What is wrong where an option is another method's, and what to do; None where all of them are its own."""
    taken = inspect.signature(METHODS[method]).parameters
    foreign = [name for name in OPTIONS if name in options and name not in taken]
    if not foreign:
        return None
    others = " or ".join(other for other, call in METHODS.items() if foreign[0] in inspect.signature(call).parameters)
    own = ", ".join(name for name in OPTIONS if name in taken)
    return f"{foreign[0]} is no option of method {method}, which has {own}; leave it out, or take method {others}"


def check_method(method: str, options: Iterable[str]) -> None:
    """InputError for an unknown method, or an option of another one: before a model is read, not after it."""
    if method not in METHODS:
        raise InputError(f"there is no method {method!r:.60}." + nearest(method, METHODS))
    if (problem := foreign_option(method, options)) is not None:
        raise InputError(problem)


def reduce_model(
    model: FiniteElementModel,
    boundary: Rows,
    *,
    method: str = "craig_bampton",
    interface_nodes: Sequence[Mapping[str, Any]] = (),
    characteristic: Mapping[str, Any] | None = None,
    damping_ratio: DampingRatio | None = None,
    progress: Callable[[str, float], None] | None = None,
    **options: Any,
) -> Component:
    """The component of a model.

    interface_nodes: arguments of `with_interface_node`, with radius_m in place of a patch, or without position_m, which is the
    middle of the patch then. characteristic: those of `characteristic_constraint_modes`. options: of the
    method. Raises InputError for unknown methods and options of others; errors of a patch name it by its place in the list.
    """
    check_method(method, options)
    boundary = list(boundary)
    patches = []
    for place, given in enumerate(interface_nodes):
        with told_of(f"interface_nodes.{place} (node {given['node']})"):
            patches.append(_with_nodes(model, given))
    _refuse_overlaps(patches, {node for rows in (boundary, options.get("loads", ())) for node, _ in rows})
    for place, given in enumerate(patches):
        with told_of(f"interface_nodes.{place} (node {given['node']})"):
            model = with_interface_node(model, **given)
    able = inspect.signature(METHODS[method]).parameters
    if damping_ratio is not None and characteristic is None and "damping_ratio" in able:
        options["damping_ratio"] = damping_ratio
    if progress is not None and "progress" in able:
        options["progress"] = progress
    component = METHODS[method](model, boundary, **options)
    if characteristic is None:
        return component
    with told_of("characteristic_modes"):
        component = characteristic_constraint_modes(component, **characteristic)
    return component if damping_ratio is None else with_modal_damping(component, damping_ratio)


def _with_nodes(model: FiniteElementModel, given: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of `with_interface_node`: the nodes within radius_m, and the middle of the patch where no position is given."""
    if model.nodes is None:
        raise ModelError(
            f"model {model.name!r} has no node positions, which a patch needs; name the deck that has them (geometry)"
        )
    options = {name: value for name, value in given.items() if name not in ("patch", "radius_m", "position_m")}
    position, patch = given.get("position_m"), given.get("patch")
    if patch is None:
        patch = _within(model, np.asarray(position, dtype=float), given["radius_m"])
    if missing := [n for n in patch if n not in model.nodes]:
        raise ModelError(f"model {model.name!r} has no node {missing[0]}." + nearest(str(missing[0]), map(str, model.nodes.ids)))
    if position is None:
        position = np.mean([model.nodes.position(n) for n in patch], axis=0)
    return {**options, "patch": patch, "position": position}


def _within(model: FiniteElementModel, position: FloatArray, radius: float) -> list[int]:
    """Nodes with DOF no farther than radius; ModelError names the nearest where there is none."""
    assert model.nodes is not None
    ids = model.dofs.nodes
    distance = np.linalg.norm(np.array([model.nodes.position(n) for n in ids]) - position, axis=1)
    inside = [n for n, d in zip(ids, distance, strict=True) if d <= radius]
    if not inside:
        near = int(np.argmin(distance))
        raise ModelError(
            f"model {model.name!r} has no node within radius_m {radius:g} of position_m; the nearest is node {ids[near]} at "
            f"{distance[near]:.4g} m"
        )
    return inside


def _refuse_overlaps(interface_nodes: Sequence[Mapping[str, Any]], named: set[int]) -> None:
    """InputError where a node is in two patches, in a patch and named itself (a patch gives DOF away), or a new one unused."""
    owner: dict[int, int] = {}
    for given in interface_nodes:
        for node in given["patch"]:
            if node in owner:
                raise InputError(
                    f"node {node} is in the patches of interface nodes {owner[node]} and {given['node']}; leave it out of one"
                )
            owner[node] = given["node"]
    if unused := [given["node"] for given in interface_nodes if given["node"] not in named]:
        raise InputError(f"interface node {unused[0]} is neither in boundary nor in loads; add it there, or leave it out")
    if both := sorted(named & set(owner)):
        raise InputError(
            f"node {both[0]} is in the patch of interface node {owner[both[0]]}, which stands for it; leave it out of the patch, "
            "or out of boundary and loads"
        )


@contextmanager
def told_of(place: str) -> Iterator[None]:
    """Errors inside begin with the key that they are about."""
    try:
        yield
    except (InputError, SolverError) as error:
        raise type(error)(*(_joined(place, line) for line in str(error).splitlines())) from None


def _joined(place: str, line: str) -> str:
    return f"{place}{'.' if line.startswith(('interface_nodes.', 'characteristic_modes:')) else ': '}{line}"
