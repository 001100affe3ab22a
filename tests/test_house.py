"""The floors of the house: who may import whom, what the lower floors never do, and how long things may grow."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "src" / "flexplant"
FLOORS = {
    "errors": 0, "model": 0, "numerics": 1, "reduction": 2, "assembly": 2, "modes": 3, "verification": 4, "plant": 4,
    "response": 5, "blocks": 5, "loop": 6, "campaign": 7, "io": 7, "report": 8, "study": 9, "cli": 10, "web": 10, "__main__": 11,
}  # fmt: skip
FACADE = {"__init__", "__main__", "py"}  # the lazy facade names every room, and imports none
QUIET = 6  # floors up to here compute only
TALKING = {"print", "open", "input"}
FILES = {"read_text", "write_text", "read_bytes", "write_bytes", "mkdir", "unlink", "savetxt", "loadtxt", "savez", "getenv"}
PLOTTING = {"matplotlib", "plotly", "pyvista", "rich", "typer", "webbrowser"}
HEAVY = {"pyyeti", "control", "pandas", "numba", "h5py", "h5netcdf", "slycot", "rslab", "sksparse", "netCDF4"}
# written for numba, and imported only once it is known to be there
COMPILED = {
    "numerics/lanes.py", "numerics/lane_sums.py", "numerics/lane_math.py", "numerics/strip_lanes.py", "response/tile_lanes.py",
    "loop/modal_steps.py", "loop/tile_steps.py", "loop/sampled_lanes.py", "loop/sampled_tiles.py", "loop/tone_steps.py",
}  # fmt: skip
LONGEST_FILE, LONGEST_FUNCTION = 400, 60


parsed = cache(ast.parse)  # every rule reads every file


def room_of(path: Path, package: Path) -> str:
    return path.relative_to(package).parts[0].removesuffix(".py")


def imported_rooms(tree: ast.AST, path: Path, package: Path) -> list[tuple[str, int]]:
    """Rooms that a file imports, anywhere in it, with the line."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [a.name for a in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = list(path.relative_to(package.parent).parts[: -node.level]) if node.level else []
            prefix = ".".join([*base, *([node.module] if node.module else [])])
            names = [prefix] if prefix.count(".") else [f"{prefix}.{a.name}" for a in node.names]
        else:
            continue
        for name in names:
            parts = name.split(".")
            if parts[0] == package.name and len(parts) > 1:
                found.append((parts[1], node.lineno))
    return found


def import_violations(package: Path) -> list[str]:
    rows = []
    for path in sorted(package.rglob("*.py")):
        room = room_of(path, package)
        where = path.relative_to(package)
        if room in FACADE:
            continue
        if room not in FLOORS:
            rows.append(f"{where}: the room {room!r} is not on the plan")
            continue
        for other, line in imported_rooms(parsed(path.read_text(encoding="utf-8")), path, package):
            if other == room or other.startswith("__") or (room == "model" and other == "errors"):
                continue
            if other not in FLOORS:
                rows.append(f"{where}:{line} imports {other!r}, which is not on the plan")
            elif FLOORS[other] >= FLOORS[room]:
                kind = "sideways" if FLOORS[other] == FLOORS[room] else "upwards"
                rows.append(f"{where}:{line} imports {kind}: {room} (floor {FLOORS[room]}) takes {other} (floor {FLOORS[other]})")
    return rows


def module_graph(package: Path) -> dict[str, set[str]]:
    """Imports between modules at their top level, by dotted name."""
    names = {
        ".".join(p.relative_to(package.parent).with_suffix("").parts).removesuffix(".__init__"): p for p in package.rglob("*.py")
    }
    graph: dict[str, set[str]] = {}
    for name, path in names.items():
        graph[name] = set()
        for node in parsed(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ImportFrom) and node.module and not node.level:
                graph[name] |= {m for m in (node.module, *(f"{node.module}.{a.name}" for a in node.names)) if m in names}
            elif isinstance(node, ast.Import):
                graph[name] |= {a.name for a in node.names if a.name in names}
        own_parts = {m for m in graph[name] if path.name == "__init__.py" and m.startswith(name + ".")}
        siblings = {m for m in graph[name] if name.startswith(m + ".")}  # `from package import sibling` runs no cycle
        graph[name] -= {name} | (siblings if not own_parts else set())
    return graph


def cycles(graph: dict[str, set[str]]) -> list[str]:
    state: dict[str, int] = {}
    found = []

    def visit(name: str, path: list[str]) -> None:
        state[name] = 1
        for other in sorted(graph.get(name, ())):
            if state.get(other) == 1:
                found.append(" -> ".join([*path[path.index(other) :], other]))
            elif other not in state:
                visit(other, [*path, other])
        state[name] = 2

    for name in sorted(graph):
        if name not in state:
            visit(name, [name])
    return found


def loud_violations(package: Path) -> list[str]:
    """print, open, files, environment and plotting on the floors that only compute."""
    rows = []
    for path, tree in low_files(package):
        where = path.relative_to(package)
        for node in ast.walk(tree):
            if isinstance(node, ast.Call):
                name = getattr(node.func, "id", "")
                method = getattr(node.func, "attr", "")
                if name in TALKING or method in FILES:
                    rows.append(f"{where}:{node.lineno} calls {name or method}()")
            if isinstance(node, ast.Attribute) and node.attr == "environ":
                rows.append(f"{where}:{node.lineno} reads the environment")
            if isinstance(node, ast.Global):
                rows.append(f"{where}:{node.lineno} changes global state")
            rows += [f"{where}:{node.lineno} imports {m}" for m in imported_packages(node) & PLOTTING]
    return rows


def heavy_violations(package: Path) -> list[str]:
    """Heavy packages imported when a low module is imported, not when it needs them."""
    return [
        f"{path.relative_to(package)}:{node.lineno} imports {m} at the top"
        for path, tree in low_files(package)
        for node in tree.body
        for m in imported_packages(node) & HEAVY
        if path.relative_to(package).as_posix() not in COMPILED
    ]


def low_files(package: Path) -> list[tuple[Path, ast.Module]]:
    files = [p for p in sorted(package.rglob("*.py")) if FLOORS.get(room_of(p, package), 99) <= QUIET]
    return [(p, parsed(p.read_text(encoding="utf-8"))) for p in files]


def imported_packages(node: ast.AST) -> set[str]:
    if isinstance(node, ast.Import):
        return {a.name.split(".")[0] for a in node.names}
    if isinstance(node, ast.ImportFrom) and not node.level:
        return {(node.module or "").split(".")[0]}
    return set()


def length_violations(package: Path) -> list[str]:
    rows = []
    for path in sorted(package.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        where = path.relative_to(package)
        if text.count("\n") > LONGEST_FILE:
            rows.append(f"{where}: {text.count(chr(10))} lines")
        for node in ast.walk(parsed(text)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                body = node.body[1:] if ast.get_docstring(node) else node.body
                length = node.end_lineno - body[0].lineno + 1 if body else 0
                if length > LONGEST_FUNCTION:
                    rows.append(f"{where}:{node.lineno} {node.name}: {length} lines")
    return rows


def undocumented(package: Path) -> list[str]:
    """Public functions, classes and methods of public classes without a docstring; overloads and registered cases aside."""
    rows = []
    for path in sorted(package.rglob("*.py")):
        tree = parsed(path.read_text(encoding="utf-8"))
        where = path.relative_to(package)
        if not ast.get_docstring(tree) and tree.body:
            rows.append(f"{where}: module")
        public = [n for n in tree.body if isinstance(n, ast.FunctionDef | ast.ClassDef) and not n.name.startswith("_")]
        inner = [m for c in public if isinstance(c, ast.ClassDef) for m in c.body if isinstance(m, ast.FunctionDef)]
        for node in [*public, *(m for m in inner if not m.name.startswith("_"))]:
            if not ast.get_docstring(node):
                rows.append(f"{where}:{node.lineno} {node.name}")
    return rows


COMPILED_HANDLERS = {"loop/user_code.py"}  # numba compiles no other handler than a broad one


def mutable_defaults(package: Path) -> list[str]:
    rows = []
    for path in sorted(package.rglob("*.py")):
        for node in ast.walk(parsed(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef) and any(
                isinstance(d, ast.List | ast.Dict | ast.Set) for d in [*node.args.defaults, *node.args.kw_defaults]
            ):
                rows.append(f"{path.relative_to(package)}:{node.lineno} {node.name}: mutable default")
            if isinstance(node, ast.ExceptHandler) and (
                node.type is None or getattr(node.type, "id", "") in {"Exception", "BaseException"}
            ):
                where = path.relative_to(package).as_posix()
                if where not in COMPILED_HANDLERS:
                    rows.append(f"{where}:{node.lineno}: broad except")
    return rows


RULES = {
    "imports": import_violations,
    "cycles": lambda package: cycles(module_graph(package)),
    "quiet": loud_violations,
    "light": heavy_violations,
    "lengths": length_violations,
    "docstrings": undocumented,
    "habits": mutable_defaults,
}


@pytest.mark.parametrize("rule", list(RULES))
def test_the_house_keeps_its_rules(rule):
    assert RULES[rule](PACKAGE) == []


PLANTED = {
    "imports": {"model/thing.py": '"""x"""\nfrom flexplant.modes import mac\n'},
    "imports sideways": {"blocks/thing.py": '"""x"""\ndef f():\n    """x"""\n    from ..response import norms\n'},
    "imports facade": {"plant/thing.py": '"""x"""\nfrom flexplant import loop\n'},
    "imports room": {"helpers/thing.py": '"""x"""\n'},
    "cycles": {"model/a.py": '"""x"""\nimport flexplant.model.b\n', "model/b.py": '"""x"""\nfrom flexplant.model import a\n'},
    "quiet": {"modes.py": '"""x"""\nprint("hello")\n'},
    "quiet files": {"model/thing.py": '"""x"""\nfrom pathlib import Path\nPath("x").write_text("y")\n'},
    "quiet plots": {"loop/thing.py": '"""x"""\ndef f():\n    """x"""\n    import matplotlib.pyplot as plt\n'},
    "quiet environment": {"plant/thing.py": '"""x"""\nimport os\nX = os.environ["HOME"]\n'},
    "light": {"response/thing.py": '"""x"""\nimport pyyeti\n'},
    "lengths": {"model/thing.py": '"""x"""\n' + "x = 1\n" * 401},
    "lengths function": {"model/thing.py": '"""x"""\ndef f():\n    """x"""\n' + "    x = 1\n" * 61},
    "docstrings": {"model/thing.py": '"""x"""\ndef f():\n    return 1\n'},
    "docstrings method": {"model/thing.py": '"""x"""\nclass A:\n    """x"""\n    def f(self):\n        return 1\n'},
    "habits": {"model/thing.py": '"""x"""\ndef f(x=[]):\n    """x"""\n'},
    "habits except": {"model/thing.py": '"""x"""\ntry:\n    pass\nexcept Exception:\n    pass\n'},
}


@pytest.mark.parametrize("planted", list(PLANTED))
def test_a_planted_violation_is_caught(planted, tmp_path):
    package = tmp_path / "flexplant"
    for name, text in PLANTED[planted].items():
        (package / name).parent.mkdir(parents=True, exist_ok=True)
        (package / name).write_text(text, encoding="utf-8")
    assert RULES[planted.split()[0]](package)


def test_a_clean_house_is_not_accused(tmp_path):
    package = tmp_path / "flexplant"
    (package / "plant").mkdir(parents=True)
    (package / "errors.py").write_text('"""x"""\n', encoding="utf-8")
    (package / "plant" / "a.py").write_text(
        '"""x"""\nfrom flexplant.modes import mac\nfrom flexplant.plant import b\n', encoding="utf-8"
    )
    (package / "plant" / "b.py").write_text('"""x"""\nfrom flexplant.errors import InputError\n', encoding="utf-8")
    assert {name: rule(package) for name, rule in RULES.items() if rule(package)} == {}
