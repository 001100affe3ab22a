"""Julia's own reader without a Julia installation, and what the few functions of our files mean.

The package ace-jax-coupling carries the Julia runtime of a compiled program (1.13). Its standard library is trimmed away, so
nothing but numbers can be evaluated there; its parser is whole. A process of its own prints the tree that Julia makes of a file.
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

PRINT = """
import ctypes, sys
from ace_jax_coupling import _loader
_loader.lib().etc_max_order()                                   # starts the runtime
runtime = ctypes.CDLL(str(next((_loader.lib_path().parent / "julia").glob("*libjulia-internal*"))))
text = open(sys.argv[1], "rb").read()
size = ctypes.c_size_t
runtime.ijl_parse_all.restype = ctypes.c_void_p
runtime.ijl_parse_all.argtypes = [ctypes.c_char_p, size, ctypes.c_char_p, size, size]
runtime.jl_.argtypes = [ctypes.c_void_p]
runtime.jl_(runtime.ijl_parse_all(text, len(text), b"p.jl", 4, 1))
"""
TOKEN = re.compile(r'\s*(#=.*?=#|Expr\(:|:var"(?:[^"\\]|\\.)*"|:[^\s,()]+|"(?:[^"\\]|\\.)*"|[-+.\w]+|[(),=])', re.DOTALL)


def julia_tree(path: Path) -> Any:
    """Nested lists [head, ...]; names as Name, numbers and strings as values."""
    run = subprocess.run([sys.executable, "-c", PRINT, str(path)], capture_output=True, text=True, timeout=120, check=True)
    printed = (run.stdout + run.stderr).strip()
    tokens = [t for t in TOKEN.findall(printed) if not t.startswith("#=")]
    assert printed.startswith("Expr(:toplevel"), printed[:200]
    tree, rest = _read(tokens, 0)
    assert rest == len(tokens)
    return tree


class Name(str):
    """A name in Julia's text."""


def _read(tokens: list[str], at: int) -> tuple[Any, int]:
    token = tokens[at]
    if token == "Expr(:":
        node, at = [tokens[at + 1]], at + 2
        while tokens[at] != ")":
            if tokens[at] == ",":
                at += 1
                continue
            item, at = _read(tokens, at)
            if tokens[at] == "=":
                value, at = _read(tokens, at + 1)
                item = ["=", item, value]
            node.append(item)
        return node, at + 1
    if token.startswith(":"):
        return Name(token[5:-1] if token.startswith(':var"') else token[1:]), at + 1
    if token.startswith('"'):
        return re.sub(r"\\(.)", r"\1", token[1:-1]), at + 1
    return (int(token) if token.lstrip("-").isdigit() else float(token)), at + 1


def system(tree: Any, name: str) -> tuple[Any, ...]:
    """What the function `name` returns: the arguments of ss or dss."""
    known: dict[str, Any] = dict(FUNCTIONS)
    for item in tree[1:]:
        evaluate(item, known)
    return known[name]()


FUNCTIONS: dict[str, Callable[..., Any]] = {
    "zeros": lambda *shape: np.zeros(shape),
    "zero": np.zeros_like,
    "reshape": lambda values, *shape: np.reshape(values, shape, order="F"),
    "-": lambda *x: -x[0] if len(x) == 1 else x[0] - x[1],
    ".*": lambda x, y: x * y,
    ".^": lambda x, y: x**y,
    ":": lambda low, high: range(low, high + 1),
    "==": lambda x, y: x == y,
    "ss": lambda *arguments: arguments,
    "dss": lambda *arguments: arguments,
}


def evaluate(node: Any, known: dict[str, Any]) -> Any:
    if isinstance(node, Name):
        return known[node]
    if not isinstance(node, list):
        return node
    head, *rest = node
    if head in ("=", "const", "function"):
        return _define(head, rest, known)
    if head == "if":
        return evaluate(rest[1] if evaluate(rest[0], known) else rest[2], known)
    if head == "comprehension":
        return _comprehension(rest[0], known)
    if head == "block":
        return [evaluate(item, known) for item in rest][-1]
    values = [evaluate(item, known) for item in (rest[1:] if head == "call" else rest)]
    if head == "call":
        return known[rest[0]](*values)
    return {"return": lambda: values[0], "vect": lambda: _vector(values), "hcat": lambda: _beside(values),
            "row": lambda: _beside(values), "vcat": lambda: _below(values)}[head]()  # fmt: skip


def _define(head: str, rest: list[Any], known: dict[str, Any]) -> None:
    if head == "const":
        evaluate(rest[0], known)
    elif head == "=":
        known[rest[0]] = evaluate(rest[1], known)
    else:
        (_, name), body = rest[0], rest[1]
        known[name] = lambda: evaluate(body, known)


def _comprehension(generator: list[Any], known: dict[str, Any]) -> np.ndarray:
    _, body, (_, i, rows), (_, j, columns) = generator
    down, along = evaluate(rows, known), evaluate(columns, known)
    values = [[evaluate(body, known | {i: r, j: c}) for c in along] for r in down]
    return np.array(values, dtype=float).reshape(len(down), len(along))


def _vector(values: list[Any]) -> Any:
    return values if values and isinstance(values[0], str) else np.array(values, dtype=float)


def _beside(values: list[Any]) -> np.ndarray:
    return np.hstack([np.reshape(v, (1, 1)) if np.ndim(v) == 0 else v for v in values])


def _below(values: list[Any]) -> np.ndarray:
    return np.vstack([np.reshape(v, (1, 1)) if np.ndim(v) == 0 else v for v in values])
