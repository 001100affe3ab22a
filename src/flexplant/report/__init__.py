"""Figures and the self-contained HTML report, from result values only."""

from flexplant.model.display import DisplayMesh
from flexplant.report.html import Item, Plot, Report, Section, Tile, render, write_report
from flexplant.report.structure import StructureView, joined

__all__ = ["DisplayMesh", "Item", "Plot", "Report", "Section", "StructureView", "Tile", "joined", "render", "write_report"]
