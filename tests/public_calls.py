"""A call of every public name with arguments that are right: what tests of wrong arguments start from."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import scipy.signal
from structures import frame_model

import flexplant as fp
from flexplant.model.display import DisplayMesh

Call = tuple[Callable[..., object], dict[str, Any]]
ENDS = [(1, "123456"), (3, "123456")]
TIP, TWO = ["whole.3.1"], ["whole.3.1", "whole.3.2"]
EYE, T = np.eye(3), np.arange(5) * 1e-3
PUBLISHED = fp.LineOfSight(focal_length=1.5, gain=2.0, mirror_omega=100.0, mirror_zeta=0.3, axes=["x"])
TEXTS = {"name": "n", "input_units": ["N"], "output_units": ["m"]}
PORT = {"inputs": ["u"], "outputs": ["y"]}
MESH = DisplayMesh([1, 2, 3], EYE, [], [[0, 1]])
DECK = "BEGIN BULK\nGRID,1,,0.,0.,0.\nGRID,2,,1.,0.,0.\nCBAR,1,1,1,2,0.,0.,1.\nENDDATA\n"
HEAD = "    -1\n    55\nmodel\nNONE\n22-Nov-26\nNONE\nNONE\n"
MODE = "         1         2         2         8         2         3\n         2         4         0         1\n"
MODE += " 2.000000e+01 1.000000e+00 0.000000e+00 0.000000e+00\n        11\n  1.00000e+00  0.00000e+00  0.00000e+00\n    -1\n"


def all_calls(folder: Path) -> dict[str, Call]:
    """By public name, with a word behind it where several calls are needed to reach every parameter."""
    model = frame_model("whole", {n: EYE[n - 1] for n in (1, 2, 3)}, [(1, 2), (2, 3)])
    part = fp.craig_bampton(model, ENDS, n_modes=3, residual_vectors=1, keep_basis=True)
    held = fp.couple([part], [fp.Connection("whole", "ground", pairs=[1])])
    plant = fp.modal_plant(held, inputs=TWO, outputs=TWO, n_modes=2, damping_ratio=0.01)
    modes = fp.normal_modes(held, n_modes=3)
    return {
        **models(model, part),
        **reductions(model, part),
        **systems(part, held, modes),
        **plants(held, modes, plant),
        **responses(held, plant),
        **loops(plant),
        **blocks(),
        **files(model, part, plant, folder),
    }


def models(model: fp.FiniteElementModel, part: fp.Component) -> dict[str, Call]:
    one, nodes, rows = np.ones((1, 2)), fp.Nodes([1], [[0.0, 0.0, 0.0]]), fp.Recovery("r", ["x"], displacement=np.ones((1, 2)))
    matrices = {"name": "c", "mass": np.eye(2), "stiffness": np.eye(2), "damping": np.eye(2), "nodes": nodes, "source": {}}
    extra = {"structural_damping": np.eye(2), "interior": [(5, 1)], "interior_rows": one, "units": "SI", "modal_ids": [7]}
    return {
        "Component": (fp.Component, {**matrices, **extra, "boundary": [(1, 1)], "recovery": [rows]}),
        "FiniteElementModel": (fp.FiniteElementModel, {**matrices, "dofs": [(1, 1), (1, 2)], "units": "SI"}),
        "with_equivalent_viscous_damping": (fp.with_equivalent_viscous_damping, {"component": part, "frequency_hz": 10.0}),
        "with_modal_damping": (fp.with_modal_damping, {"component": part, "ratio": 0.01}),
        "DofSet": (fp.DofSet, {"node": [1, 2], "direction": [1, 1]}),
        "Nodes": (fp.Nodes, {"ids": [1], "positions": np.zeros((1, 3)), "frames": [EYE]}),
        "Placement": (fp.Placement, {"rotation": EYE, "translation": np.zeros(3)}),
        "cylindrical_frame": (fp.cylindrical_frame, {"position": EYE[0], "origin": np.zeros(3), "axes": EYE}),
        "rigid_body_vectors": (
            fp.rigid_body_vectors,
            {"nodes": model.nodes, "dofs": model.dofs, "about": np.zeros(3), "placement": fp.Placement()},
        ),
        "Recovery": (
            fp.Recovery,
            {"name": "r", "labels": ["x"], "displacement": one, "velocity": one, "acceleration": one, "units": "m"},
        ),
        "UnitSystem": (fp.UnitSystem, {"name": "u", "length": 1.0, "mass": 1.0, "mass_factor": 1.0}),
        "component_to_si": (fp.component_to_si, {"component": part, "units": "mm-tonne-s"}),
        "model_to_si": (fp.model_to_si, {"model": model, "units": "mm-tonne-s"}),
    }


def reductions(model: fp.FiniteElementModel, part: fp.Component) -> dict[str, Call]:
    resources = {"progress": None, "threads": None, "memory_limit": None, "backend": "superlu", "keep_basis": False}
    both = {"model": model, "boundary": ENDS, "recover": [(2, 1)], "keep_basis": False}
    most = {**both, **resources, "max_frequency_hz": 1e4, "n_modes": 2, "loads": [(2, 1)], "damping_ratio": 0.01}
    more = {"residual_vectors": 0, "structural_damping": 0.01, "verify_count": False, "error_estimate": False}
    corners = {n: np.array([x, y, z]) for n, (x, y, z) in enumerate([(1, 1, 0), (1, -1, 0), (-1, 0, 0), (0, 0, 1)], 1)}
    patch = frame_model("plate", corners, [(1, 2), (2, 3), (3, 1), (1, 4)])
    node = {"model": patch, "node": 99, "position": np.zeros(3), "patch": [1, 2, 3]}
    chosen = {"model": model, "boundary": ENDS, "max_frequency_hz": 300.0}
    return {
        "characteristic_constraint_modes": (
            fp.characteristic_constraint_modes,
            {"component": part, "keep": ENDS[:1], "max_frequency_hz": 1e5, "n_modes": 2},
        ),
        "craig_bampton": (fp.craig_bampton, {**most, **more}),
        "craig_bampton by accuracy": (fp.craig_bampton, {**chosen, "accuracy": 1e-3}),
        "craig_bampton by size": (fp.craig_bampton, {**chosen, "size": 6}),
        "expand": (fp.expand, {"component": part, "coordinates": np.ones(part.n)}),
        "expansion": (fp.expansion, {"component": part, "recovery": "mug1"}),
        "guyan": (fp.guyan, both),
        "rubin": (fp.rubin, {**most, "error_estimate": False}),
        "with_dampers": (fp.with_dampers, {"model": model, "dampers": [((1, 1), (2, 1), 3.0)]}),
        "with_dampers of one": (
            lambda a, b, c: fp.with_dampers(model, [(a, b, c)]),
            {"a": (1, 1), "b": (2, 1), "c": 3.0},
        ),
        "with_interface_node": (fp.with_interface_node, {**node, "kind": "rigid", "directions": "123456"}),
        "with_interface_node averaged": (fp.with_interface_node, {**node, "kind": "average", "weights": np.ones(3)}),
        "with_proportional_damping": (
            fp.with_proportional_damping,
            {"model": model, "mass_factor": 0.1, "stiffness_factor": 0.1},
        ),
    }


def systems(part: fp.Component, held: fp.System, modes: fp.Modes) -> dict[str, Call]:
    pair = {"a": part, "b": part}
    two = fp.couple(pair, [fp.Connection("a", "b", pairs=[(3, 1)], name="tie")])
    link = {"a": "a", "b": "b", "pairs": [(3, 1)], "directions": "123", "name": "n", "frame": "a", "offset": "rigid"}
    more = {"tolerance": 0.1, "nodes": [1], "stiffness": 1.0, "damping": 1.0}
    check = {"name": "n", "value": 1.0, "limit": 1.0, "passed": True, "unit": "", "explanation": ""}
    known = {"frequency_hz": [1.0], "shapes": np.ones((1, 1)), "labels": ["a.1.1"], "names": ["first"]}
    limits = {"rigid_body_modes": 0, "reference": [1.0], "frequency_tolerance": 1e-3, "mac_minimum": 0.9, "reduction_error": 0.01}
    return {
        "Connection": (fp.Connection, {**link, **more}),
        "characteristic_interface": (fp.characteristic_interface, {"system": two, "connection": "tie", "n_modes": 6}),
        "characteristic_interface to": (
            fp.characteristic_interface,
            {"system": two, "connection": "tie", "max_frequency_hz": 1e9},
        ),
        "couple": (
            fp.couple,
            {"components": pair, "connections": [fp.Connection("a", "b", pairs=[(3, 1)])], "method": "dual", "placements": {}},
        ),
        "couple pairs": (lambda pairs: fp.couple(pair, [fp.Connection("a", "b", pairs=pairs)]), {"pairs": [(3, 1)]}),
        "mode_view": (
            fp.mode_view,
            {"system": held, "modes": modes, "meshes": {"whole": MESH}, "numbers": [1], "labels": [], "recovery": "mug1"},
        ),
        "Modes": (
            fp.Modes,
            {"frequency_hz": [1.0], "shapes": np.ones((3, 1)), "residuals": [0.0], "n_rigid": 0, "labels": ["a", "b", "c"]},
        ),
        "effective_mass": (fp.effective_mass, {"modes": modes, "model": held, "motion": np.ones((held.n, 1))}),
        "mac": (fp.mac, {"a": np.ones((3, 1)), "b": np.ones((3, 2))}),
        "normal_modes": (fp.normal_modes, {"model": held, "max_frequency_hz": 1e4, "n_modes": 2}),
        "Check": (fp.Check, check),
        "CheckReport": (fp.CheckReport, {"checks": (), "tables": (), "notes": ()}),
        "CheckReport by name": (fp.CheckReport((fp.Check(**check),)).__getitem__, {"name": "n"}),
        "Reference": (fp.Reference, {**known, "rigid_below_hz": 0.01, "source": "s", "provenance": {}}),
        "check_component": (fp.check_component, {"component": part}),
        "mass_properties": (fp.mass_properties, {"model": part}),
        "strain_energy": (fp.strain_energy, {"component": part, "placement": fp.Placement()}),
        "verify": (fp.verify, {"system": held, **limits, "modes": modes, "max_frequency_hz": 1e4}),
        "estimate_error": (fp.estimate_error, {"system": held, "modes": None, "max_frequency_hz": 1e4, "n_modes": 3}),
    }


def plants(held: fp.System, modes: fp.Modes, plant: fp.ModalPlant) -> dict[str, Call]:
    import control  # takes a second, which collecting tests need not wait for

    one = [[1.0]]
    shapes = {"shape_in": one, "shape_out": one, "shape_out_velocity": one, "shape_out_acceleration": one}
    direct = {"damping": one, "static_correction": one, "feedthrough": one, "report": {}}
    matrices = {"A": EYE, "B": np.ones((3, 1)), "C": np.ones((1, 3)), "D": [[0.0]], **PORT, **TEXTS, "source": {}}
    ask = {"system": held, "inputs": TIP, "outputs": TIP, "name": "p"}
    how = {"max_frequency_hz": 1e5, "n_modes": 2, "damping_ratio": 0.01, "off_diagonal_damping": "keep"}
    ss = fp.state_space(plant)
    return {
        "ModalPlant": (fp.ModalPlant, {"omega": [1.0], "zeta": [0.1], **shapes, **direct, **PORT, **TEXTS, "source": {}}),
        "modal_plant": (fp.modal_plant, {**ask, **how, "static_correction": False}),
        "modal_plant of modes": (fp.modal_plant, {"system": held, "inputs": TIP, "outputs": TIP, "modes": modes}),
        "select": (fp.select, {"plant": plant, "inputs": TIP, "outputs": TIP}),
        "descriptor": (fp.descriptor, ask),
        "Descriptor": (fp.Descriptor, {**matrices, "E": EYE}),
        "StateSpace": (fp.StateSpace, {**matrices, "dt": 0.1}),
        "state_space": (fp.state_space, {"plant": plant}),
        "discretize": (fp.discretize, {"plant": plant, "dt": 1e-3, "hold": "zero"}),
        "without_rigid_body": (fp.without_rigid_body, {"plant": plant}),
        "hankel_singular_values": (fp.hankel_singular_values, {"plant": plant}),
        "peak_gains": (fp.peak_gains, {"plant": plant}),
        "reduce_modes": (fp.reduce_modes, {"plant": plant, "keep": 1, "measure": "peak", "static_correction": True}),
        "reduce_modes to": (fp.reduce_modes, {"plant": plant, "tolerance": 0.1}),
        "balanced_truncation": (fp.balanced_truncation, {"system": ss, "order": 2}),
        "balanced_truncation to": (fp.balanced_truncation, {"system": ss, "tolerance": 0.1}),
        "from_control": (fp.from_control, {"system": control.ss([[-1.0]], one, one, [[0.0]]), **PORT, "name": "n"}),
        "from_scipy": (fp.from_scipy, {"system": scipy.signal.StateSpace([[-1.0]], one, one, [[0.0]]), **PORT, "name": "n"}),
        "to_control": (fp.to_control, {"plant": ss}),
        "to_scipy": (fp.to_scipy, {"plant": ss}),
    }


def responses(held: fp.System, plant: fp.ModalPlant) -> dict[str, Call]:
    G = np.ones((1, 1, 3), dtype=complex)
    parts = {"G_zw": G, "G_zu": G, "G_yw": G, "G_yu": 0.5 * G}
    L, hz = fp.loop_gain(PUBLISHED), [1.0, 2.0]
    return {
        "singular_values": (fp.singular_values, {"plant": plant, "frequency_hz": hz}),
        "bandwidth_hz": (fp.bandwidth_hz, {"plant": L, "level_db": -3.0}),
        "crossing_hz": (fp.crossing_hz, {"plant": L, "level_db": -3.0}),
        "complementary_sensitivity": (fp.complementary_sensitivity, {"loop_gain": L}),
        "sensitivity": (fp.sensitivity, {"loop_gain": L}),
        "margins": (fp.margins, {"loop_gain": L}),
        "structural_frequency_response": (
            fp.structural_frequency_response,
            {"system": held, "inputs": TIP, "outputs": TIP, "frequency_hz": hz},
        ),
        "GainSweep": (fp.GainSweep, parts),
        "GainSweep at": (lambda **k: fp.GainSweep(**parts)(**k), {"gain": 1.0, "out": np.ones_like(G)}),
        "adaptive_grid": (fp.adaptive_grid, {"system": L, "low_hz": 1.0, "high_hz": 9.0, "per_mode": 5, "per_decade": 9}),
        "h2_norm": (fp.h2_norm, {"plant": plant}),
        "white_noise_rms": (fp.white_noise_rms, {"plant": plant, "intensity": np.eye(2)}),
        "frequency_response": (fp.frequency_response, {"system": plant, "frequency_hz": hz, "out": None}),
        "frequency_response_blocks": (
            lambda **k: list(fp.frequency_response_blocks(**k)),
            {"system": plant, "frequency_hz": hz, "block": 1},
        ),
        "hinf_norm": (fp.hinf_norm, {"system": L, "tolerance": 1e-3, "unbounded": "infinite"}),
        "plot": (fp.plot, {"result": fp.frequency_response(L, hz), "output": L.outputs[0], "input": L.inputs[0], "title": "t"}),
        "random_response": (
            fp.random_response,
            {"system": L, "psd": {"error_x": 1.0}, "frequency_hz": hz, "cross": False, "interpolation": "linear"},
        ),
    }


def loops(plant: fp.ModalPlant) -> dict[str, Call]:
    wheel = fp.Wheel(amplitude=1e-6, harmonics=[1.0, 2.0])
    driven = fp.ModalPlant(omega=[9.0], zeta=0.1, shape_in=np.ones((1, 6)), shape_out=[[1.0]], inputs=wheel.inputs, outputs=["y"])
    tones = fp.Tones(frequency_hz=[1.0], amplitude=[[1.0], [0.0]], inputs=plant.inputs)
    diagram = fp.line_of_sight_diagram(PUBLISHED)
    ss, at = fp.state_space(plant), "mirror.angle_x"
    lens = {"lens": fp.thin_lens(1.5, axes=["x"])}
    wired = {"blocks": {"a": fp.gain(1.0), "b": fp.gain(1.0)}, "outputs": {"z": "b.y"}}
    run = {"outputs": TIP, "every": 1, "progress": None, "unstable": "error", "hold": "first", "initial": None}
    stream = {
        "dt": 1e-3,
        "samples": 5,
        "start": 0.0,
        "every": 1,
        "piece": 10,
        "unstable": "error",
        "hold": "first",
        "progress": None,
    }
    optics = {"focal_length": 1.5, "gain": 1800.0, "mirror_omega": 100.0, "mirror_zeta": 0.3, "axes": ["x", "y"]}
    reads = {"plant_outputs": TIP, "closed": True, "commands": False, "signals": ["spot"]}
    return {
        "Diagram": (
            fp.Diagram,
            {"blocks": lens, "outputs": {"z": "lens.tilt_x"}, "allow_algebraic_loops": False, "name": "d"}
            | {"inputs": {"w": "lens.decenter_x"}},
        ),
        "Diagram wired": (fp.Diagram, {**wired, "connections": [("a.y", "b.u")], "inputs": {"w": ["a.u"]}}),
        "close": (fp.close, {"diagram": diagram}),
        "harmonic_response": (fp.harmonic_response, {"system": plant, "tones": tones}),
        "wheel_speed_sweep": (fp.wheel_speed_sweep, {"systems": driven, "wheel": wheel, "omega_hz": [1.0, 2.0]}),
        "wheel_speed_sweep of cases": (
            fp.wheel_speed_sweep,
            {"systems": {"a": driven}, "wheel": wheel, "omega_hz": [1.0, 2.0]},
        ),
        "loop_margins": (fp.loop_margins, {"diagram": diagram, "at": at}),
        "loop_response": (fp.loop_response, {"diagram": diagram, "at": at, "frequency_hz": [1.0]}),
        "LineOfSight": (fp.LineOfSight, optics),
        **{name: (getattr(fp, name), {"los": PUBLISHED}) for name in ("closed_loop_transfer", "loop_gain", "output_sensitivity")},
        "loop_figures": (fp.loop_figures, {"los": PUBLISHED}),
        "line_of_sight_diagram": (fp.line_of_sight_diagram, {"los": PUBLISHED, "plant": plant, **reads}),
        "simulate": (fp.simulate, {"system": ss, "time": T, "inputs": np.zeros((2, 5)), **run}),
        "simulate tones": (fp.simulate, {"system": ss, "time": T, "inputs": tones, **run}),
        "simulate_stream": (
            lambda **k: next(iter(fp.simulate_stream(**k))),
            {"system": ss, **stream, "inputs": None, "initial": None},
        ),
    }


def blocks() -> dict[str, Call]:
    siso = {"input_name": "u", "output_name": "y", "name": "n"}
    units = {"input_unit": "m", "output_unit": "m"}
    law = {"channels": 1, "name": "n", "unit": "m"}
    optics = ("angle_sensor", "line_of_sight_geometry", "thin_lens")
    wheel = fp.Wheel(amplitude=1e-6, harmonics=[1.0])
    tones = fp.wheel_tones(wheel, 1.0)
    return {
        "gain": (fp.gain, {"factor": 2.0, **PORT, **TEXTS}),
        "renamed": (fp.renamed, {"system": fp.gain(1.0), **PORT, **TEXTS}),
        "summing_junction": (fp.summing_junction, {"signs": "+-", "output_name": "s", "unit": "m", "name": "n"}),
        "summing_junction of one": (lambda sign: fp.summing_junction({"a": sign}), {"sign": 1.0}),
        "proportional": (fp.proportional, {"gains": 1.0, "axes": ["x"], "name": "n"}),
        "pade_delay": (fp.pade_delay, {"seconds": 0.1, "order": 2, **siso, "unit": "m"}),
        "sample_delay": (fp.sample_delay, {"samples": 2, "dt": 0.1, **siso, "unit": "m"}),
        "steering_mirror": (fp.steering_mirror, {"omega": 1.0, "zeta": 0.1, "axes": ["x"], "name": "n"}),
        **{name: (getattr(fp, name), {"focal_length": 1.5, "axes": ["x"], "name": "n"}) for name in optics},
        "flat_mirror": (fp.flat_mirror, {"axes": ["x"], "name": "n"}),
        "pid": (fp.pid, {"kp": 1.0, "ki": 1.0, "kd": 1.0, "filter_time": 0.1, **siso, **units}),
        "dead_zone": (fp.dead_zone, {"low": -1.0, "high": 1.0, **law}),
        "saturation": (fp.saturation, {"low": -1.0, "high": 1.0, **law}),
        "quantiser": (fp.quantiser, {"step": 0.1, "dt": 0.1, **law}),
        "rate_limiter": (fp.rate_limiter, {"fall": -1.0, "rise": 1.0, **law}),
        "user_block": (fp.user_block, {"function": lambda _t, u, x: (u, x), **PORT, **TEXTS, "initial": [0.0], "dt": 0.1}),
        "Tones": (fp.Tones, {"frequency_hz": [1.0], "amplitude": [[1.0]], "inputs": ["u"]}),
        "tone_signal": (fp.tone_signal, {"tones": tones, "time": T, "sampling": "point"}),
        "transfer_function": (
            fp.transfer_function,
            {"numerator": [1.0], "denominator": [1.0, 1.0], "dt": 0.1, **siso, **units},
        ),
        "Wheel": (
            fp.Wheel,
            {"amplitude": 1e-6, "harmonics": [1.0], "phase_rad": 0.0, "rotation": EYE, "inputs": list("abcdef")},
        ),
        "wheel_disturbance": (fp.wheel_disturbance, {"wheel": wheel, "omega_hz": 1.0, "time": T[:1], "sampling": "point"}),
        "wheel_tones": (fp.wheel_tones, {"wheel": wheel, "omega_hz": 1.0}),
    }


def files(model: fp.FiniteElementModel, part: fp.Component, plant: fp.ModalPlant, folder: Path) -> dict[str, Call]:
    gain = fp.frequency_response(plant, [1.0])
    fp.write_component(part, folder / "c.npz")
    fp.write_model(model, folder / "m.npz")
    fp.write_plant(plant, folder / "p.npz")
    fp.write_results(gain, folder / "r.nc")
    (folder / "deck.bdf").write_text(DECK)
    (folder / "test.uff").write_text(HEAD + MODE)
    np.savez(folder / "plate.npz", M=np.eye(1), K=np.eye(1))
    (folder / "plate.yaml").write_text("matrices: {mass: M, stiffness: K}\nboundary: [[7, '1']]\nmodal: 0\nunits: SI\n")
    kind, new, over = {"format": None, "units": None}, folder / "new.npz", {"overwrite": True}
    put = {"read_options": None, "drop": [], **over}
    return {
        "convert": (fp.convert, {"path": folder / "c.npz", "target": new, "name": "n", **kind, **put}),
        "inspect": (fp.inspect, {"path": folder / "c.npz", **kind}),
        "plausibility": (fp.plausibility, {"model": part, "found": None}),
        "read_component": (fp.read_component, {"path": folder / "c.npz", "name": "n", "damping": 0.01, **kind}),
        "read_component option": (fp.read_component, {"path": folder / "c.npz", "max_bytes": 1e9}),
        "read_display_mesh": (fp.read_display_mesh, {"path": folder / "plate.npz", **kind}),
        "read_geometry": (fp.read_geometry, {"path": folder / "deck.bdf", **kind}),
        "read_model": (fp.read_model, {"path": folder / "m.npz", "name": "n", **kind}),
        "read_plant": (fp.read_plant, {"path": folder / "p.npz"}),
        "read_reference": (fp.read_reference, {"path": folder / "test.uff", "component": "bus", "units": None}),
        "read_response_functions": (fp.read_response_functions, {"path": folder / "test.uff", "units": None}),
        "read_results": (fp.read_results, {"path": folder / "r.nc"}),
        "write_component": (fp.write_component, {"component": part, "path": new, "basis": False, **over}),
        "write_model": (fp.write_model, {"model": model, "path": folder / "new_model.npz", **over}),
        "write_plant": (fp.write_plant, {"plant": plant, "path": folder / "new_plant.npz", "sources": [], **over}),
        "write_plant as C": (fp.write_plant, {"plant": plant, "path": folder / "w.c", "dt": 1e-3, "hold": "zero", "name": "n"}),
        "write_plant as FMU": (
            partial(fp.write_plant, binary=False),
            {"plant": plant, "path": folder / "w.fmu", "version": 3, "arrays": True, "dt": 0.1, "name": "n"},
        ),
        "write_results": (fp.write_results, {"results": gain, "path": folder / "w.nc", **over}),
        "write_results of pieces": (
            lambda append: fp.write_results(iter([gain.rename(frequency="time")]), folder / "p.nc", append=append),
            {"append": False},
        ),
        "run_study": (fp.run_study, {"path": "study.yaml", "output": None, "allow_outside": False, "progress": None}),
        "example_study": (fp.example_study, {"name": "shocksat"}),
    }
