"""A mode shape: the deformed mesh over the undeformed one, coloured by how far each node moves."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go

from flexplant.model.arrays import FloatArray, IntArray
from flexplant.model.display import DisplayMesh
from flexplant.report.figures.theme import ACCENT, GREY, TEMPLATE, plain
from flexplant.report.structure import StructureView

DRAWN = 0.12  # largest displacement as drawn, of the mesh's extent
SCALE = "Viridis"


def mode_shape(view: StructureView, *, mode: int | None = None) -> go.Figure:
    """One mode of a view in three dimensions; mode: place in the view from 0, None takes its first flexible one."""
    k = view.first_mode if mode is None else mode
    mesh, shape = view.mesh, np.asarray(view.shapes[k])
    moved = np.linalg.norm(shape, axis=1)
    largest = float(moved.max()) or 1.0
    extent = float(np.ptp(mesh.positions, axis=0).max()) or 1.0
    deformed = mesh.positions + shape * (DRAWN * extent / largest)
    still = mesh if view.still is None else view.still
    traces = [_lines(still.positions, _edges(still), GREY, "undeformed", 1.0), *_surfaces(mesh, deformed, moved / largest)]
    traces += [_lines(deformed, _edges(mesh), ACCENT, "deformed", 2.5), _nodes(mesh, deformed, moved / largest)]
    figure = go.Figure([trace for trace in traces if trace is not None])
    figure.update_layout(
        template=TEMPLATE,
        title={"text": f"<b>{plain(view.captions[k])}</b>", "x": 0, "xref": "container", "pad": {"l": 8}, "font": {"size": 15}},
        scene={
            "aspectmode": "data",
            "camera": {"eye": {"x": 1.4, "y": 1.4, "z": 0.9}},
            **{f"{axis}axis": {"title": {"text": f"{axis} (m)"}} for axis in "xyz"},
        },
        legend={"orientation": "h", "yanchor": "bottom", "y": 1.0, "xanchor": "right", "x": 1},
        margin={"l": 10, "r": 10, "t": 56, "b": 10},
        height=520,
    )
    return figure


def _edges(mesh: DisplayMesh) -> IntArray:
    """(n, 2) lines of the mesh and sides of its quads, each once."""
    sides = [mesh.quads[:, [i, (i + 1) % 4]] for i in range(4)]
    pairs = np.sort(np.vstack([mesh.lines, *sides]), axis=1)
    return np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0)


def _lines(points: FloatArray, edges: IntArray, color: str, name: str, width: float) -> go.Scatter3d | None:
    if not len(edges):
        return None
    ends = np.full((len(edges), 3, 3), np.nan)  # a gap behind each line
    ends[:, :2] = points[edges]
    x, y, z = ends.reshape(-1, 3).T.astype(np.float32)
    return go.Scatter3d(x=x, y=y, z=z, mode="lines", line={"color": color, "width": width}, name=name, hoverinfo="skip")


def _surfaces(mesh: DisplayMesh, points: FloatArray, share: FloatArray) -> list[go.Mesh3d]:
    if not len(mesh.quads):
        return []
    triangles = np.vstack([mesh.quads[:, [0, 1, 2]], mesh.quads[:, [0, 2, 3]]])
    i, j, k = triangles[(triangles[:, 1] != triangles[:, 2])].T
    x, y, z = points.T.astype(np.float32)
    colours = {"intensity": share, "colorscale": SCALE, "cmin": 0, "cmax": 1, "showscale": False}
    return [go.Mesh3d(x=x, y=y, z=z, i=i, j=j, k=k, opacity=0.85, hoverinfo="skip", **colours)]


def _nodes(mesh: DisplayMesh, points: FloatArray, share: FloatArray) -> go.Scatter3d:
    x, y, z = points.T.astype(np.float32)
    marker = {"size": 2.5, "color": share, "colorscale": SCALE, "cmin": 0, "cmax": 1}
    marker["colorbar"] = {"title": {"text": "displacement / largest"}, "thickness": 14, "len": 0.7}
    texts = [f"node {node}" for node in mesh.nodes.tolist()]
    return go.Scatter3d(
        x=x, y=y, z=z, mode="markers", marker=marker, text=texts, customdata=share.astype(np.float32), showlegend=False,
        hovertemplate="%{text}<br>%{customdata:.3f}<extra></extra>",
    )  # fmt: skip
