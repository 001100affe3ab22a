"""What a study file may say: one frozen pydantic model a section; descriptions here become docs/study-file.md."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from flexplant.study.fields import (
    DampingRatio,
    Directions,
    Finite,
    FormatOptions,
    NodeId,
    NotNegative,
    Positive,
    Rotation,
    Section,
    StudyPath,
    Vector,
)
from flexplant.study.schema_line_of_sight import LineOfSightSpec
from flexplant.study.schema_outputs import ExportSpec, ReportSpec, ResponseSpec
from flexplant.study.schema_reduce import CharacteristicSpec, ReduceSpec


class PlacementSpec(Section):
    """Where a component stands in the system: x_system = rotation x_component + translation."""

    rotation: Rotation = Field(
        default=((1, 0, 0), (0, 1, 0), (0, 0, 1)),
        description="three rows of a right-handed rotation matrix",
    )
    translation: Vector = Field(default=(0, 0, 0), description="metres")


class UnitsSpec(Section):
    """A consistent unit system by its size; time is the second."""

    length_m: Positive = Field(description="one unit of length in metres")
    mass_kg: Positive = Field(description="one unit of mass in kilograms")


class ComponentSpec(Section):
    """One component; its key is its name in connections and channel names."""

    file: StudyPath = Field(description="model file, relative to the study's folder")
    format: str | None = Field(default=None, description="format name; left out: decided by the file itself")
    options: FormatOptions = Field(
        default={},
        description="options of the format, such as superelement, part, sidecar, mapping (docs/formats.md); paths as for file",
    )
    units: str | UnitsSpec | None = Field(
        default=None,
        description='units of the file: a preset name such as "SI" or "mm-tonne-s", or length_m and mass_kg',
    )
    damping: DampingRatio | None = Field(
        None,
        description="modal damping ratio of the component (equation 4): one value, one a mode, or rows [frequency_hz, ratio]",
    )
    placement: PlacementSpec | None = Field(default=None, description="rotation and translation; left out: not moved")
    reduce: ReduceSpec | None = Field(default=None, description="the file holds an unreduced model: reduce it like this")
    geometry: StudyPath | None = Field(
        default=None,
        description="deck or listing with the node positions that an unreduced model lacks; without `reduce`, the bulk data "
        "whose mesh the report draws, moved by the component's displacement recovery (mug1)",
    )

    @model_validator(mode="after")
    def _modes_to_damp(self) -> ComponentSpec:
        how = self.reduce
        if self.damping is not None and how is not None and how.method == "guyan" and how.characteristic_modes is None:
            raise ValueError("damping is that of modes, which method guyan has not; leave it out, or damp the coupled modes")
        return self


class ConnectionSpec(Section):
    """Two components joined node by node."""

    a: str = Field(description="first component")
    b: str = Field(description="second component")
    nodes: list[NodeId] | None = Field(
        default=None,
        description='node ids that are the same on both sides; with "by position": nodes of a',
    )
    pairs: list[tuple[NodeId, NodeId]] | Literal["by position"] | None = Field(
        default=None,
        description='[node of a, node of b] rows, or "by position"',
    )
    directions: Directions = Field(default="123456", description="joined directions, digits 1-6")
    tolerance_m: Positive | None = Field(default=None, description="largest distance of nodes matched by position, metres")
    frame: Literal["a", "b", "system"] = Field(default="a", description="displacement frame of the directions")
    offset: Literal["rigid", "ignore", "forbid"] = Field(
        default="rigid",
        description="for nodes that are apart: rigid (a rigid link), ignore, or forbid (an error)",
    )
    stiffness: list[NotNegative] | None = Field(
        default=None,
        description="compliant joint: N/m and N m/rad, one value a direction",
    )
    damping: list[NotNegative] | None = Field(
        default=None,
        description="compliant joint: N s/m and N m s/rad, one value a direction",
    )
    name: str | None = Field(default=None, description="name for interface forces")
    characteristic_modes: CharacteristicSpec | None = Field(
        default=None, description="a large rigid interface in few coordinates that both components share"
    )

    @model_validator(mode="after")
    def _rigid_where_reduced(self) -> ConnectionSpec:
        if self.characteristic_modes is not None and (self.stiffness is not None or self.damping is not None):
            raise ValueError("characteristic_modes are those of a rigid interface; leave out stiffness and damping, or them")
        return self

    @model_validator(mode="after")
    def _one_way_of_pairing(self) -> ConnectionSpec:
        if self.nodes is None and self.pairs is None:
            raise ValueError("give nodes (same ids on both sides), or pairs")
        if self.nodes is not None and isinstance(self.pairs, list):
            raise ValueError("give either nodes or a list of pairs, not both")
        return self


class GroundSpec(Section):
    """Nodes of a component held fixed."""

    component: str = Field(description="component name")
    nodes: list[NodeId] = Field(min_length=1, description="node ids")
    directions: Directions = Field(default="123456", description="held directions, digits 1-6")


class DampingSpec(Section):
    """Modal damping of the coupled system."""

    ratio: DampingRatio = Field(description="damping ratio: one value, or rows [frequency_hz, ratio]")
    on: Literal["system", "components"] = Field(
        default="system",
        description="system: on the coupled modes; components: equation 4 on every component without damping of its own",
    )


class ReferenceSpec(Section):
    """Frequencies (and shapes) to compare the coupled modes with."""

    file: StudyPath | None = Field(default=None, description=".npz with frequency_hz, or text with one frequency a line")
    frequency_hz: list[Finite] | None = Field(
        default=None,
        description="reference frequencies instead of a file, rigid-body modes first",
    )
    name: str = Field(default="reference", description="what the reference is, for tables")
    note: str = Field(default="", description="what a reader must know about the reference, shown under its table")
    limit: Positive = Field(default=1e-3, description="largest accepted relative error of the compared frequencies")
    modes: int = Field(default=4, ge=1, description="number of flexible modes held to the limit")
    labels: list[str] = Field(default=[], description="names of the first flexible modes, for tables")
    published_hz: list[Positive] = Field(
        default=[],
        description="published frequencies of the first flexible modes, for tables only",
    )

    @model_validator(mode="after")
    def _one_source(self) -> ReferenceSpec:
        if (self.file is None) == (self.frequency_hz is None):
            raise ValueError("give either file or frequency_hz")
        return self


class VerificationSpec(Section):
    """Checks of the coupled model."""

    rigid_body_modes: int = Field(default=6, ge=0, le=6, description="expected number of rigid-body modes")
    rigid_body_share: Positive | None = Field(
        default=None,
        description="largest accepted rigid-body frequency over the first flexible one, before it is set to zero; left out: any",
    )
    reference: ReferenceSpec | None = Field(default=None, description="table against a reference")
    max_frequency_hz: Positive | None = Field(
        default=None,
        description="coupled modes listed up to here; left out: the plant's limit",
    )
    reduction_error: Positive = Field(
        default=0.01,
        description="largest accepted estimated relative error that `reduce` causes in any frequency up to the plant's limit",
    )


class PlantSpec(Section):
    """The modal plant."""

    inputs: list[str] = Field(min_length=1, description="force inputs: component.node.directions")
    outputs: list[str] = Field(
        min_length=1,
        description="outputs: component.node.directions (:v or :a for rates), or component.recovery.label",
    )
    max_frequency_hz: Positive | None = Field(default=None, description="modes above are truncated; left out: all modes kept")
    static_correction: bool | Literal["modes"] = Field(
        default=True,
        description="the static response of the truncated modes: true adds a direct term, modes adds residual modes",
    )
    off_diagonal_damping: Literal["keep", "drop"] = Field(
        default="keep",
        description="what to do with modal damping that couples modes",
    )
    drop_tolerance: Positive | None = Field(
        default=None,
        description="drop modes that matter less than this share of the largest; left out: drop none",
    )


class TruthSpec(Section):
    """An unreduced model of the whole, solved frequency by frequency beside the plant."""

    file: StudyPath = Field(description="mass and stiffness of the whole model")
    format: str | None = Field(default=None, description="format name; left out: decided by the file itself")
    options: FormatOptions = Field(
        default={},
        description="options of the format, such as superelement, part, sidecar, mapping (docs/formats.md); paths as for file",
    )
    input: str = Field(description="plant input, component.node.direction; the whole model has the same node id")
    output: str = Field(description="plant output, component.node.direction; the whole model has the same node id")
    structural_damping: NotNegative = Field(
        description="factor g of K (1 + i g), used on both sides of the comparison; 2 zeta gives the same resonance peaks",
    )
    components: dict[str, ComponentSpec] = Field(
        default={},
        description="components taken instead of those of the study, for a second plant that is compared too",
    )
    frequency: ResponseSpec = Field(default=ResponseSpec(), description="where to compare")


class StudySpec(Section):
    """A study: components, how they are joined, what is asked of the coupled structure."""

    title: str = Field(min_length=1, description="title of the report")
    statement: str = Field(default="", description="what a reader must know about the models, shown at the top of the report")
    components: dict[str, ComponentSpec] = Field(min_length=1, description="components by name")
    connections: list[ConnectionSpec] = Field(default=[], description="joints between components")
    ground: list[GroundSpec] = Field(default=[], description="nodes held fixed")
    method: Literal["dual", "primal"] = Field(
        default="dual",
        description="dual: Lagrange multipliers (equations 5-11); primal: constraints eliminated",
    )
    damping: DampingSpec | None = Field(default=None, description="modal damping; left out: what the components bring")
    verification: VerificationSpec = Field(default=VerificationSpec(), description="checks of the coupled model")
    plant: PlantSpec = Field(description="the modal plant")
    response: ResponseSpec = Field(default=ResponseSpec(), description="transfer functions of the plant")
    truth: TruthSpec | None = Field(default=None, description="comparison with an unreduced model")
    line_of_sight: LineOfSightSpec | None = Field(default=None, description="wheel, optics and controller")
    report: ReportSpec = Field(default=ReportSpec(), description="what the report shows")
    export: list[ExportSpec] = Field(default=[], description="the plant in further formats")

    @model_validator(mode="after")
    def _files_apart(self) -> StudySpec:
        files = [f"{e.name}.{e.to}" for e in self.export]
        if twice := sorted({f for f in files if files.count(f) > 1}):
            raise ValueError(f"export writes {twice[0]} twice; give one of them another name")
        return self
