"""What a study file may say about reducing a model, and about interfaces in few coordinates."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, model_validator

from flexplant.study.fields import Directions, NodeId, NodeRange, Positive, Section, Vector, nodes_of
from flexplant.study.reduction import OPTIONS, foreign_option

AVERAGED = 3  # nodes that an averaging patch needs at least


def _distinct_rows(rows: list[tuple[int | str, str]]) -> list[tuple[int | str, str]]:
    _refuse_repeated([f"{node}-{direction}" for node, directions in expanded(rows) for direction in directions])
    return rows


def _distinct_nodes(nodes: list[int | str]) -> list[int | str]:
    _refuse_repeated([str(node) for named in nodes for node in nodes_of(named)])
    return nodes


def expanded(rows: Iterable[tuple[int | str, str]]) -> list[tuple[int, str]]:
    """[node, directions] rows with a row for each node of a range."""
    return [(node, directions) for named, directions in rows for node in nodes_of(named)]


def _refuse_repeated(names: list[str]) -> None:
    if twice := [name for name, count in Counter(names).items() if count > 1]:
        raise ValueError(f"lists {', '.join(twice[:4])} twice; leave one out")


Rows = Annotated[list[tuple[NodeRange, Directions]], AfterValidator(_distinct_rows)]
Patch = Annotated[list[NodeRange], AfterValidator(_distinct_nodes), Field(min_length=1)]


class InterfaceNodeSpec(Section):
    """A new node of six directions that stands for a patch of nodes, as a bolted flange; take it as boundary."""

    node: NodeId = Field(description="id of the new node, which the model does not have")
    kind: Literal["average", "rigid"] = Field(
        description="average (RBE3): it follows the patch, which stays flexible; rigid (RBE2): the patch follows it"
    )
    patch: Patch | None = Field(default=None, description='nodes of the patch; "17-40" is nodes 17 to 40')
    radius_m: Positive | None = Field(default=None, description="or all nodes that are no farther from position_m")
    position_m: Vector | None = Field(default=None, description="where it is, metres; left out: the middle of the patch")
    directions: Directions = Field(default="123456", description="directions in which a rigid patch follows")
    weights: list[Positive] | None = Field(default=None, description="of an averaging patch, one a node; left out: all alike")

    @property
    def nodes(self) -> list[int]:
        """The patch, one by one."""
        return [node for named in self.patch or () for node in nodes_of(named)]

    @property
    def arguments(self) -> dict[str, Any]:
        """What was given, for `reduce_model`."""
        given = self.model_dump(exclude_unset=True)
        return given if self.patch is None else {**given, "patch": self.nodes}

    @model_validator(mode="after")
    def _patch_or_radius(self) -> InterfaceNodeSpec:
        if (self.patch is None) == (self.radius_m is None):
            raise ValueError("give either patch, a list of nodes, or radius_m")
        if self.radius_m is not None and self.position_m is None:
            raise ValueError("radius_m needs position_m, from which it is measured")
        return self

    @model_validator(mode="after")
    def _own_options(self) -> InterfaceNodeSpec:
        other = {"rigid": "weights", "average": "directions"}[self.kind]
        if other in self.model_fields_set:
            raise ValueError(f"{other} is no option of kind: {self.kind}; leave it out")
        if self.kind == "average" and self.patch is not None and len(self.nodes) < AVERAGED:
            raise ValueError("an averaging patch needs three nodes or more, not on one line; add nodes, or take kind: rigid")
        return self


class CharacteristicSpec(Section):
    """How many characteristic constraint modes, the modes in which an interface moves, describe it."""

    n_modes: int | None = Field(default=None, ge=1, description="so many of the slowest")
    max_frequency_hz: Positive | None = Field(default=None, description="or those up to here")

    @model_validator(mode="after")
    def _one_limit(self) -> CharacteristicSpec:
        if (self.max_frequency_hz is None) == (self.n_modes is None):
            raise ValueError("give either max_frequency_hz or n_modes")
        return self


class KeptCharacteristicSpec(CharacteristicSpec):
    """Boundary DOF that nothing is coupled to one by one, described by the modes in which they move; others are kept."""

    keep: Rows = Field(min_length=1, description='boundary [node, "123456"] rows that stay: what connections and channels name')

    @property
    def arguments(self) -> dict[str, Any]:
        """What was given, for `characteristic_constraint_modes`."""
        return {**self.model_dump(exclude_unset=True), "keep": expanded(self.keep)}


class ReduceSpec(Section):
    """Reduction of an unreduced model to a component; the methods, and what they are good for: docs/reduction.md."""

    method: Literal["craig_bampton", "rubin", "guyan"] = Field(
        default="craig_bampton",
        description="craig_bampton (modes with the boundary held, residual vectors), rubin (free modes, residual flexibility) or "
        "guyan (statics only, no options but boundary, recover, keep_basis and those of interfaces)",
    )
    boundary: Rows = Field(min_length=1, description='[node, "123456"] rows: interface, loads; "17-40" is nodes 17 to 40')
    interface_nodes: list[InterfaceNodeSpec] = Field(
        default=[], description="new nodes for patches of nodes, made before the reduction"
    )
    max_frequency_hz: Positive | None = Field(default=None, description="modes up to here")
    n_modes: int | None = Field(default=None, ge=0, description="or this many modes")
    residual_vectors: int = Field(
        default=0, ge=0, le=10, description="craig_bampton: blocks of load-dependent Ritz vectors beside the modes"
    )
    accuracy: Positive | None = Field(
        default=None, description="craig_bampton: or as many as this relative error of any frequency up to there needs"
    )
    size: int | None = Field(
        default=None, ge=1, description="craig_bampton: or the best basis up to there of so many coordinates"
    )
    loads: Rows = Field(
        default=[], description='interior [node, "123"] rows that become inputs and outputs, with their own residual vectors'
    )
    recover: Rows = Field(default=[], description='[node, "123"] rows that become outputs, component.displacement.node.direction')
    characteristic_modes: KeptCharacteristicSpec | None = Field(
        default=None, description="a large boundary in few coordinates, after the reduction"
    )
    keep_basis: bool = Field(default=False, description="keep the shapes of the whole model, for expand (in Python)")

    @property
    def options(self) -> dict[str, Any]:
        """Options of the method that were given."""
        given = {name: getattr(self, name) for name in OPTIONS if name in self.model_fields_set}
        rows = {name: expanded(given[name]) for name in ("loads", "recover") if name in given}
        return {name: value for name, value in (given | rows).items() if value is not None}

    @model_validator(mode="after")
    def _own_options(self) -> ReduceSpec:
        if (problem := foreign_option(self.method, self.options)) is not None:
            raise ValueError(problem)
        return self

    @model_validator(mode="after")
    def _one_limit(self) -> ReduceSpec:
        if self.method != "guyan" and (self.max_frequency_hz is None) == (self.n_modes is None):
            raise ValueError("give either max_frequency_hz or n_modes")
        promises = [name for name in ("accuracy", "size") if getattr(self, name) is not None]
        if len(promises) > 1 or (promises and (self.n_modes is not None or self.residual_vectors)):
            raise ValueError(f"{promises[0]} goes with max_frequency_hz alone")
        return self

    @model_validator(mode="after")
    def _interface_nodes_are_used(self) -> ReduceSpec:
        ids = [spec.node for spec in self.interface_nodes]
        _refuse_repeated([f"interface node {node}" for node in ids])
        held = {node for node, _ in expanded((*self.boundary, *self.loads))}
        if unused := [node for node in ids if node not in held]:
            raise ValueError(f"interface node {unused[0]} is neither in boundary nor in loads; add [{unused[0]}, '123456'] there")
        return self
