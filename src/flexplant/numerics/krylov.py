"""The recurrence of block Lanczos in the inner product of a semidefinite mass, fully reorthogonalised with BLAS-3."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.linalg.blas import dgemm

from flexplant.model.arrays import FloatArray
from flexplant.numerics.blocks import minus, shares
from flexplant.numerics.products import product
from flexplant.numerics.rank import EPS

DEPENDENT = 1e-11  # of a block's size before it was made orthogonal: what is left below that is round-off
SHRUNK = 1e-3  # of that size: below it one more orthogonalisation is needed
WELL_CONDITIONED = 1e-3  # smallest eigenvalue of a unit-diagonal Gram matrix above which one pass makes it orthonormal
CHUNK = 8192  # rows rotated at a time in a restart, so that it needs no second basis, and copied at a time


class Krylov:
    """Basis V (n, capacity) with V^T M V = I and T = V^T M OP V, OP = (K - s M)^-1 M.

    The first `locked` columns are given motions, outside T; then come the blocks, of which the last, [last, size), has not
    met the operator. A column of a block that depends on the basis is replaced by a random direction in the operator's
    range; where none is left, `exhausted` is set: V holds every finite mode.
    """

    def __init__(
        self, solve: Callable[[FloatArray], FloatArray], mass: Any, locked: FloatArray, capacity: int, block: int, seed: int
    ) -> None:
        self.solve, self.mass, self.block = solve, mass, block
        self.random = np.random.default_rng(seed)
        self.locked = locked.shape[1]
        self.basis = np.empty((mass.shape[0], self.locked + capacity), order="F")
        self.basis[:, : self.locked] = locked
        self.projection = np.zeros((capacity, capacity))
        self.size = self.last = self.locked
        self.exhausted = False
        self.coupling = np.zeros((0, 0))
        self._local: tuple[FloatArray, ...] = ()  # M V of the newest blocks, at most two; none after a restart
        start = self._random_block(block)
        image = product(mass, start)
        self._append(start, image, norms(start, image).max(initial=0.0))

    @property
    def room(self) -> bool:
        """Whether another block fits."""
        return bool(self.size + self.block <= self.basis.shape[1])

    def _random_block(self, columns: int) -> FloatArray:
        """Vectors in the range of the operator, so that they carry no massless part."""
        return self.solve(product(self.mass, self.random.standard_normal((self.basis.shape[0], columns))))

    def _purged(self, block: FloatArray, image: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The block without its part in the basis, and M times it."""
        columns = self.basis[:, : self.size]
        block = minus(block, columns, shares(columns, image))
        return block, product(self.mass, block)

    def step(self) -> None:
        """W = OP V_j; orthogonal to the local blocks, which extends T, then to all; Q of W = Q B is the next block."""
        low, last, end = self.locked, self.last, self.size
        mine = self._local[-1] if self._local else product(self.mass, self.basis[:, last:end])
        block = self.solve(mine)
        if self._local:
            share = np.vstack([shares(image, block) for image in self._local])
        else:
            share = shares(self.basis[:, low:end], product(self.mass, block))
        first = end - share.shape[0]
        block = minus(block, self.basis[:, first:end], share)
        image = product(self.mass, block)
        scale = float(np.hypot(np.linalg.norm(share, axis=0), norms(block, image)).max(initial=0.0))
        self.projection[first - low : end - low, last - low : end - low] = share
        self.projection[last - low : end - low, first - low : end - low] = share.T
        self.last = end
        self.coupling = self._append(block, image, scale)
        self._local = (mine, *self._local[-1:])

    def _append(self, block: FloatArray, image: FloatArray, scale: float) -> FloatArray:
        """Add Q of block = Q B, completed to the block's width; returns B, (width of Q, columns of block)."""
        block, image = self._purged(block, image)
        q, image, b = factored(block, image, DEPENDENT * scale)
        if b.size and smallest(b) < SHRUNK * scale:
            q, image, again = factored(*self._purged(q, image), 0.5)
            b = again @ b
        if q.shape[1] < self.block:
            fresh, fresh_image = self._fresh(q, image)
            q, image = np.hstack([q, fresh]), np.hstack([image, fresh_image])
            b = np.vstack([b, np.zeros((fresh.shape[1], b.shape[1]))])
        for start in range(0, q.shape[0], CHUNK):  # rows that are near still when the next column takes them
            self.basis[start : start + CHUNK, self.size : self.size + q.shape[1]] = q[start : start + CHUNK]
        self.size += q.shape[1]
        self._local = (image,)
        return b

    def _fresh(self, q: FloatArray, image: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Random directions outside basis and q; fewer than needed, and `exhausted`, where the space has closed."""
        missing = self.block - q.shape[1]
        block = self._random_block(missing)
        block_image = product(self.mass, block)
        limit = DEPENDENT * norms(block, block_image).max(initial=0.0)
        for _ in range(2):
            block, block_image = self._purged(minus(block, q, shares(image, block)), block_image)
            block, block_image, _ = factored(block, block_image, limit)
            limit = 0.5
        self.exhausted = block.shape[1] < missing
        return block, block_image

    def ritz(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Ritz values theta of the operator, their vectors in T's columns, and residual norms |B s_last|."""
        used = self.last - self.locked
        theta, s = np.linalg.eigh(self.projection[:used, :used])
        return theta, s, np.linalg.norm(self.coupling @ s[used - self.coupling.shape[1] :], axis=0)

    def vectors(self, theta: FloatArray, s: FloatArray) -> FloatArray:
        """Ritz vectors after one more, implicit, application of the operator: X = V S + V_next B S_last / theta."""
        tail = self.coupling @ s[s.shape[0] - self.coupling.shape[1] :] / theta
        columns = self.basis[:, self.locked : self.size]
        return np.asarray(dgemm(1.0, columns, np.vstack([s, tail])))

    def restart(self, theta: FloatArray, s: FloatArray) -> None:
        """Thick restart: keep the Ritz vectors V S and the residual block, which couples to all of them."""
        low, keep, wide = self.locked, theta.size, self.size - self.last
        residual = self.basis[:, self.last : self.size].copy()
        for start in range(0, self.basis.shape[0], CHUNK):
            rows = slice(start, start + CHUNK)
            self.basis[rows, low : low + keep] = self.basis[rows, low : self.last] @ s
        self.basis[:, low + keep : low + keep + wide] = residual
        self.projection[:] = 0.0
        self.projection[:keep, :keep] = np.diag(theta)
        self.last, self.size, self._local = low + keep, low + keep + wide, ()


def norms(block: FloatArray, image: FloatArray) -> FloatArray:
    """Mass norms of columns, (k,), from the block and M times it."""
    return np.asarray(np.sqrt(np.maximum(np.einsum("ij,ij->j", block, image), 0.0)))


def smallest(b: FloatArray) -> float:
    """A lower bound of the smallest singular value of B (r, k), sharp to a factor k: 1 / |B^-1|."""
    return float(1 / np.linalg.norm(np.linalg.inv(b))) if b.shape[0] == b.shape[1] else 0.0


def factored(block: FloatArray, image: FloatArray, limit: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """block = Q B with Q^T M Q = I, given image = M block; also M Q. Directions not larger than `limit` are left out."""
    b = np.eye(block.shape[1])
    for cut in (DEPENDENT, 0.0):
        gram = shares(block, image)
        size = np.sqrt(np.maximum(np.diagonal(gram), 0.0))
        live = np.flatnonzero(size > limit)
        size, limit = size[live], 0.0
        values, vectors = np.linalg.eigh(0.5 * (gram + gram.T)[np.ix_(live, live)] / np.outer(size, size))
        keep = values > max(cut, EPS * gram.shape[0])
        root, vectors = np.sqrt(values[keep]), vectors[:, keep]
        turn = np.zeros((block.shape[1], root.size))
        turn[live] = vectors / root / size[:, None]
        block, image, b = block @ turn, image @ turn, root[:, None] * (vectors.T @ (size[:, None] * b[live]))
        if values.size and values[0] > WELL_CONDITIONED:
            break
    return block, image, b
