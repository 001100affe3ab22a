"""modelDescription.xml of an FMU, for FMI 2.0 and 3.0, and buildDescription.xml of 3.0."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
from xml.sax.saxutils import quoteattr

import numpy as np

from flexplant.io.parse.own_plant import Plant
from flexplant.model.arrays import FloatArray

# exponents of kg, m, s and rad of the units that plants have; others are declared by name only
BASE_UNITS = {
    "N": {"kg": 1, "m": 1, "s": -2}, "N m": {"kg": 1, "m": 2, "s": -2}, "Nm": {"kg": 1, "m": 2, "s": -2},
    "m": {"m": 1}, "m/s": {"m": 1, "s": -1}, "m/s²": {"m": 1, "s": -2}, "m/s^2": {"m": 1, "s": -2},
    "rad": {"rad": 1}, "rad/s": {"rad": 1, "s": -1}, "rad/s²": {"rad": 1, "s": -2}, "rad/s^2": {"rad": 1, "s": -2},
}  # fmt: skip


@dataclass(frozen=True)
class About:
    """What both descriptions say: model identifier, token, the plant, its feedthrough, its sample time, a step to suggest."""

    model: str
    token: str
    plant: Plant
    direct: FloatArray
    dt: float | None
    step: float | None


def variable_names(plant: Plant) -> tuple[list[str], list[str]]:
    """Names of the inputs and outputs in an FMU, where one list holds both: what is in both gets ":in" and ":out"."""
    shared = set(plant.inputs) & set(plant.outputs)

    def told(names: Sequence[str], end: str) -> list[str]:
        return [f"{name}:{end}" if name in shared else name for name in names]

    return told(plant.inputs, "in"), told(plant.outputs, "out")


def description_2(about: About) -> str:
    """FMI 2.0: one variable a channel, inputs first, value references in that order."""
    plant, first = about.plant, len(about.plant.inputs)
    inputs, outputs = variable_names(plant)
    variables = [_scalar(i, n, u, "input") for i, (n, u) in enumerate(zip(inputs, plant.input_units, strict=True))]
    for k, (name, unit) in enumerate(zip(outputs, plant.output_units, strict=True)):
        variables.append(_scalar(first + k, name, unit, "output"))
    unknowns = [_unknown("Unknown index", first + k + 1, np.flatnonzero(row) + 1) for k, row in enumerate(about.direct)]
    interpolates = _truth(about.dt is None)
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName={quoteattr(plant.name)} guid="{about.token}"
  generationTool="flexplant" variableNamingConvention="flat" numberOfEventIndicators="0">
  <CoSimulation modelIdentifier="{about.model}" canHandleVariableCommunicationStepSize="{interpolates}"
    canInterpolateInputs="{interpolates}" canGetAndSetFMUstate="true" canSerializeFMUstate="true"
    canBeInstantiatedOnlyOncePerProcess="false" needsExecutionTool="false">
    <SourceFiles>
      <File name="{about.model}.c"/>
    </SourceFiles>
  </CoSimulation>
{_units(plant)}  <LogCategories>
    <Category name="logStatusError"/>
  </LogCategories>
{_experiment(about)}  <ModelVariables>
{_lines(variables, 4)}  </ModelVariables>
  <ModelStructure>
    <Outputs>
{_lines(unknowns, 6)}    </Outputs>
    <InitialUnknowns>
{_lines(unknowns, 6)}    </InitialUnknowns>
  </ModelStructure>
</fmiModelDescription>
"""


def _scalar(reference: int, name: str, unit: str, causality: str) -> str:
    start, initial = (' start="0"', "") if causality == "input" else ("", ' initial="calculated"')
    head = f'<ScalarVariable name={quoteattr(name)} valueReference="{reference}" causality="{causality}"'
    return f'{head} variability="continuous"{initial}><Real{_unit(unit)}{start}/></ScalarVariable>'


def description_3(about: About, arrays: bool) -> str:
    """FMI 3.0: arrays u and y with their names and units as constant texts, or one variable a channel."""
    plant, direct = about.plant, about.direct
    if arrays:
        variables = [*_array(plant, "input"), *_array(plant, "output")]
        unknowns = [(2, [1] if direct.any() else [])]
    else:
        names, units = [*chain(*variable_names(plant))], [*plant.input_units, *plant.output_units]
        first = len(plant.inputs)
        variables = [
            _float64(i + 1, n, u, "input" if i < first else "output") for i, (n, u) in enumerate(zip(names, units, strict=True))
        ]
        unknowns = [(first + k + 1, (np.flatnonzero(row) + 1).tolist()) for k, row in enumerate(direct)]
    sampled = "" if about.dt is None else f' fixedInternalStepSize="{about.dt!r}"'
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName={quoteattr(plant.name)} instantiationToken="{about.token}"
  generationTool="flexplant" variableNamingConvention="flat">
  <CoSimulation modelIdentifier="{about.model}" canHandleVariableCommunicationStepSize="{_truth(about.dt is None)}"{sampled}
    canGetAndSetFMUState="true" canSerializeFMUState="true"
    canBeInstantiatedOnlyOncePerProcess="false" needsExecutionTool="false"/>
{_units(plant)}  <LogCategories>
    <Category name="logStatusError"/>
  </LogCategories>
{_experiment(about)}  <ModelVariables>
    <Float64 name="time" valueReference="0" causality="independent" variability="continuous"/>
{_lines(variables, 4)}  </ModelVariables>
  <ModelStructure>
{_lines([_unknown("Output valueReference", *unknown) for unknown in unknowns], 4)}\
{_lines([_unknown("InitialUnknown valueReference", *unknown) for unknown in unknowns], 4)}  </ModelStructure>
</fmiModelDescription>
"""


def _array(plant: Plant, causality: str) -> list[str]:
    """The array itself, and its names and units as texts."""
    name, reference = ("u", 1) if causality == "input" else ("y", 2)
    names, units = getattr(plant, f"{causality}s"), getattr(plant, f"{causality}_units")
    common = units[0] if len(set(units)) == 1 else ""
    about = "; ".join(f"{n} [{u}]" if u else n for n, u in zip(names, units, strict=True))
    body = f'<Dimension start="{len(names)}"/>'
    texts = [
        f'<String name="{name}.{what}" valueReference="{3 + 2 * (reference - 1) + i}" causality="local" variability="constant">'
        f"{body}{''.join(f'<Start value={quoteattr(t)}/>' for t in listed)}</String>"
        for i, (what, listed) in enumerate((("names", names), ("units", units)))
    ]
    return [_float64(reference, name, common, causality, about, len(names)), *texts]


def _float64(reference: int, name: str, unit: str, causality: str, about: str = "", size: int | None = None) -> str:
    start = f' start="{" ".join(["0"] * (size or 1))}"' if causality == "input" else ' initial="calculated"'
    text = f" description={quoteattr(about)}" if about else ""
    head = f'<Float64 name={quoteattr(name)} valueReference="{reference}" causality="{causality}" variability="continuous"'
    dimension = "" if size is None else f'<Dimension start="{size}"/>'
    return f"{head}{text}{_unit(unit)}{start}>{dimension}</Float64>"


def build_description(model: str) -> str:
    """sources/buildDescription.xml of FMI 3.0."""
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiBuildDescription fmiVersion="3.0">
  <BuildConfiguration modelIdentifier="{model}">
    <SourceFileSet language="C99">
      <SourceFile name="{model}.c"/>
    </SourceFileSet>
  </BuildConfiguration>
</fmiBuildDescription>
"""


def _truth(value: bool) -> str:
    return "true" if value else "false"


def _lines(texts: Iterable[str], indent: int) -> str:
    return "".join(f"{' ' * indent}{text}\n" for text in texts)


def _unit(unit: str) -> str:
    return f" unit={quoteattr(unit)}" if unit else ""


def _units(plant: Plant) -> str:
    """Definitions of the units in use."""
    used = dict.fromkeys(u for u in (*plant.input_units, *plant.output_units) if u)
    if not used:
        return ""
    listed = []
    for unit in used:
        base = " ".join(f'{k}="{v}"' for k, v in BASE_UNITS.get(unit, {}).items())
        listed.append(f"<Unit name={quoteattr(unit)}>{f'<BaseUnit {base}/>' if base else ''}</Unit>")
    return f"  <UnitDefinitions>\n{_lines(listed, 4)}  </UnitDefinitions>\n"


def _experiment(about: About) -> str:
    step = about.dt or about.step
    return "" if step is None else f'  <DefaultExperiment stepSize="{step!r}"/>\n'


def _unknown(kind: str, number: int, dependencies: Iterable[int]) -> str:
    """An output, and the inputs that it follows without delay: what an importer needs to find algebraic loops."""
    listed = [str(d) for d in dependencies]
    kinds = " ".join(["dependent"] * len(listed))
    return f'<{kind}="{number}" dependencies="{" ".join(listed)}" dependenciesKind="{kinds}"/>'
