"""Options of `flexplant reduce`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Model = Annotated[Path, typer.Argument(help="Unreduced model: mass and stiffness with their DOF.")]
Boundary = Annotated[str, typer.Option(help="node,node-node:directions; several groups separated by blanks.")]
Output = Annotated[
    Path, typer.Option("--output", "-o", help="Component file to write; its ending chooses the format (docs/formats.md).")
]
Method = Annotated[str, typer.Option(help="craig_bampton, rubin (free modes) or guyan (statics only).")]
MaxFrequency = Annotated[float | None, typer.Option(help="Modes up to here, Hz.")]
Count = Annotated[int | None, typer.Option(help="Or this many of them.")]
Ritz = Annotated[
    int | None, typer.Option("--residual-vectors", "--ritz", help="Blocks of load-dependent Ritz vectors beside the modes.")
]
Accuracy = Annotated[float | None, typer.Option(help="Instead: relative frequency error up to --max-frequency.")]
Size = Annotated[int | None, typer.Option(help="Instead: modal coordinates to spend on frequencies up to --max-frequency.")]
AveragePatch = Annotated[
    list[str] | None,
    typer.Option(help="New node that averages a patch (RBE3): 9001=101,105-120, @x,y,z for its place; or 9001=0.03@x,y,z."),
]
RigidPatch = Annotated[list[str] | None, typer.Option(help="New node that a patch follows rigidly (RBE2), written alike.")]
Loads = Annotated[str | None, typer.Option(help="Interior DOF for forces and motions, as --boundary.")]
Recover = Annotated[str | None, typer.Option(help="DOF that become recovery rows, as --boundary.")]
Keep = Annotated[str | None, typer.Option(help="Boundary DOF that stay; characteristic modes describe the others.")]
InterfaceModes = Annotated[int | None, typer.Option(help="So many characteristic modes, with --keep.")]
InterfaceFrequency = Annotated[float | None, typer.Option(help="Or those up to here, Hz.")]
KeepBasis = Annotated[bool, typer.Option("--keep-basis", help="Write the shapes of the whole model too (.npz, .h5).")]
Geometry = Annotated[Path | None, typer.Option(help="Deck with the node positions that the model lacks.")]
Name = Annotated[str | None, typer.Option(help="Name of the component; left out: that of the model's file.")]
