"""The best basis of a given size, and the smallest of a given accuracy: what worst boundary motions need of a large one."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg as la

from flexplant.model.arrays import FloatArray
from flexplant.reduction.bound import Basis
from flexplant.reduction.interior import Interior

KEPT = (1.05, 1.15, 1.3, 1.5)  # exact modes are kept up to these multiples of the frequency asked; the bound chooses among them
SNAPSHOTS = 24  # frequencies at which motions are drawn, denser towards both ends
LOAD_MOMENTS = 2  # answers of interior loads that are kept whatever the boundary needs: static, and to their own inertia


@dataclass(frozen=True, eq=False)
class Drawn(Interior):
    """Interior vectors drawn from a larger basis of `drawn_from` vectors.

    rows: L (k, n_b + n_q) in the order boundary, modes, other vectors.
    """

    rows: FloatArray | None = None
    drawn_from: int = 0

    @cached_property
    def error_rows(self) -> FloatArray:
        """L in the component's coordinates; see `Interior.error_rows`."""
        assert self.rows is not None
        split = self.part.b.size + self.modes.shape[1]
        turned = np.hstack([self.rows[:, :split], self.rows[:, split:] @ self.rotation[1]])
        n_b = self.part.b.size
        return turned[:, [*range(n_b), *(n_b + i for i in self.order)]]


@dataclass(frozen=True, eq=False)
class Draw:
    """Ranked vectors of a large basis: its first `kept` modes stay, then columns of `ranked` (n_q - kept, m), best first.

    The large basis is in `basis`, in the order modes, other vectors. Columns come from the motions p of `Basis.motions` at
    many frequencies w, by proper orthogonal decomposition: with energy w_q^2 |q|^2 / w^2, which is the relative error of w^2
    that losing them costs, weighted by the inverse square of the frequency, so that low modes are kept better.
    """

    basis: Basis
    kept: int
    ranked: FloatArray
    forced: int

    @classmethod
    def of(cls, interior: Interior, basis: Basis, max_frequency_hz: float, multiple: float) -> Draw:
        """The ranking where modes up to `multiple` of the frequency are kept."""
        kept = int(np.count_nonzero(interior.omega2 <= (2 * np.pi * multiple * max_frequency_hz) ** 2))
        omega = np.sqrt(basis.diagonal[kept:])
        answers = _load_answers(interior, kept) * omega[:, None]
        forced = la.orth(answers) if answers.shape[1] else answers
        energy = np.zeros((omega.size, omega.size))
        for hz in 0.5 * max_frequency_hz * (1 - np.cos(np.pi * (np.arange(SNAPSHOTS) + 0.5) / SNAPSHOTS)):
            moved = omega[:, None] * basis.motions(hz)[basis.mbb.shape[0] + kept :] / hz**2
            moved -= forced @ (forced.T @ moved)
            energy += moved @ moved.T
        vectors = la.eigh(energy)[1][:, ::-1]
        return cls(basis, kept, np.hstack([forced, vectors]) / omega[:, None], forced.shape[1])

    @property
    def smallest(self) -> int:
        """Vectors that a basis has at least."""
        return self.kept + self.forced

    def drawn(self, size: int) -> tuple[Basis, FloatArray]:
        """The basis of `size` vectors, and the combinations C (n_q - kept, size - kept) of the large one's that it adds."""
        big, n_b = self.basis, self.basis.mbb.shape[0]
        c = la.qr(self.ranked[:, : size - self.kept], mode="economic")[0] if size > self.kept else self.ranked[:, :0]
        values, turn = la.eigh(c.T @ (big.diagonal[self.kept :, None] * c)) if c.shape[1] else (np.zeros(0), np.zeros((0, 0)))
        c = c @ turn
        map_ = la.block_diag(np.eye(n_b + self.kept), c)
        rows = np.vstack([self._lost(c), big.rows @ map_])
        complete = min(big.complete, float(big.diagonal[self.kept])) if self.kept < big.diagonal.size else big.complete
        mqb = map_[n_b:, n_b:].T @ big.mqb
        return Basis(big.mbb, big.kbb, mqb, np.r_[big.diagonal[: self.kept], values], _triangle(rows), complete), c

    def _lost(self, c: FloatArray) -> FloatArray:
        """Error rows of what the large basis has and the drawn one lacks: static answers K-orthogonal to C."""
        root = np.sqrt(self.basis.diagonal[self.kept :])
        held = la.qr(root[:, None] * c, mode="economic")[0] if c.shape[1] else c
        answers = np.hstack([self.basis.mqb[self.kept :], np.zeros((root.size, self.kept)), c]) / root[:, None]
        for _ in range(2):
            answers = answers - held @ (held.T @ answers)
        return answers

    def interior(self, large: Interior, size: int) -> Drawn:
        """The drawn vectors themselves."""
        basis, c = self.drawn(size)
        vectors = np.hstack([large.modes[:, self.kept :], large.ritz @ large.rotation[1]])
        modes, omega2 = large.modes[:, : self.kept], large.omega2[: self.kept]
        told = {"blocks": large.blocks, "rows": basis.rows, "drawn_from": large.raw.shape[1]}
        return Drawn(large.part, modes, omega2, basis.complete, large.proved, large.loads, vectors @ c, **told)


def draws(interior: Interior, max_frequency_hz: float) -> Iterable[Draw]:
    """Rankings that differ in how many modes stay exact."""
    n_b, inverse = interior.part.b.size, np.argsort(interior.order)
    ordered = Basis.of(interior)
    rows = ordered.rows[:, [*range(n_b), *(n_b + i for i in inverse)]]
    basis = Basis(ordered.mbb, ordered.kbb, ordered.mqb[inverse], ordered.diagonal[inverse], rows, ordered.complete)
    known: set[int] = set()
    for multiple in KEPT:
        draw = Draw.of(interior, basis, max_frequency_hz, multiple)
        if draw.kept not in known:
            known.add(draw.kept)
            yield draw


def _load_answers(interior: Interior, kept: int) -> FloatArray:
    """(n_q - kept, k) answers q = f / w_q^2, f / w_q^4, ... of the coordinates that may go to the interior loads."""
    force = np.vstack([interior.modes.T @ interior.loads, interior.rotation[1].T @ (interior.ritz.T @ interior.loads)])
    omega2 = np.r_[interior.omega2, interior.rotation[0]][kept:, None]
    answers = [force[kept:] / omega2**k for k in range(1, LOAD_MOMENTS + 1)]
    return np.hstack([a / np.maximum(np.linalg.norm(a, axis=0), np.finfo(float).tiny) for a in answers])


def _triangle(rows: FloatArray) -> FloatArray:
    """Fewer rows R with the same R^T R."""
    return np.asarray(la.qr(rows, mode="r")[0][: rows.shape[1]]) if rows.shape[0] > rows.shape[1] else rows
