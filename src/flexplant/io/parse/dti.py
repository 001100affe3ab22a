"""DTI tables TUG1, TEF1, TES1, ...: what the rows of Nastran's recovery matrices are."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from flexplant.io.parse.bulk import Card

ELEMENT_TYPES = {1: "CROD", 2: "CBEAM", 4: "CSHEAR", 10: "CONROD", 11: "CELAS1", 12: "CELAS2", 33: "CQUAD4", 34: "CBAR",
                 39: "CTETRA", 64: "CQUAD8", 67: "CHEXA", 68: "CPENTA", 74: "CTRIA3", 75: "CTRIA6", 95: "CQUAD4C", 102: "CBUSH",
                 144: "CQUAD4B"}  # fmt: skip
GRID_TYPE, SCALAR_TYPE = 1, 2


@dataclass
class RecoveryTable:
    """Blocks of rows: (type, id, number of rows, first row); element: whether the types are element types."""

    element: bool
    blocks: list[tuple[int, int, int, int]] = field(default_factory=list)

    def labels(self, n_rows: int) -> list[str]:
        """One label a row; rows that no block names keep their number."""
        out = [str(i + 1) for i in range(n_rows)]
        for kind, identity, count, first in self.blocks:
            for i in range(count):
                if 0 < first + i <= n_rows:
                    out[first + i - 1] = self._label(kind, identity, i + 1)
        return out

    def _label(self, kind: int, identity: int, item: int) -> str:
        if not self.element:
            return f"{identity}.{0 if kind == SCALAR_TYPE and item == 1 else item}"
        return f"{ELEMENT_TYPES.get(kind, f'type{kind}')}.{identity}.{item}"


def recovery_tables(cards: Iterable[Card]) -> dict[str, RecoveryTable]:
    """Tables by name, from record 2 of each: rows of TYPE, ID, COMP (row count), ROW (first row) after a line of headings."""
    out: dict[str, RecoveryTable] = {}
    for card in cards:
        if card.name == "DTI" and card.text(0)[:1].upper() == "T" and card.text(1) == "2":
            table = RecoveryTable(element=card.text(0).upper()[:2] in ("TE", "TG"))
            table.blocks = [_block(card, at) for at in _starts(card)]
            out[card.text(0).upper()] = table
    return out


def _starts(card: Card) -> list[int]:
    """Places of the blocks: groups of four after the headings, up to ENDREC."""
    values = [f.upper() for f in card.fields]
    begin = values.index("TYPE") if "TYPE" in values else 8
    while begin + 4 <= len(values) and values[begin] == "TYPE":
        begin += 4
    end = values.index("ENDREC") if "ENDREC" in values else len(values)
    return [at for at in range(begin, end - 3, 4) if values[at]]


def _block(card: Card, at: int) -> tuple[int, int, int, int]:
    kind, identity, count, first = (card.integer(at + i) for i in range(4))
    if not 0 <= count <= 10**5:
        raise card.fail(f"claims {count} rows for one entry")
    return kind, identity, count, first
