"""A digest of everything on which the result of a function depends: its code, and everything to which the code refers.

It uses the compiled code, since the text in the file may have been edited after the import. Comments and docstrings do not count.
Python's version counts, because the compiled code depends on it.
"""

from __future__ import annotations

import dis
import functools
import hashlib
import sys
import types
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

MUTATORS = frozenset(
    "append extend insert add update setdefault pop popitem clear remove discard sort reverse appendleft popleft put".split()
)
"""Names of methods that change their object."""

STORES = frozenset({"STORE_SUBSCR", "DELETE_SUBSCR", "STORE_ATTR", "DELETE_ATTR"})
INSTALLED = ("site-packages", "dist-packages")
DEPTH = 20
"""Depth to which the contents of containers and objects are followed."""


def measure_digest(measure: Callable[..., Any]) -> str:
    """SHA-256, 16 digits, of a function and of everything it refers to.

    It covers code and defaults; variables of the closure; functions, classes, objects and values of the user's own modules,
    recursively; and the contents of models and solvers.

    It does not cover the standard library and installed packages, C code, files, the environment, and variables that the function
    itself changes, such as a counter. For other objects, only the class counts.

    Parameters
    ----------
    measure : callable
        A function, a method, a `functools.partial` or an object that can be called.
    """
    seen: dict[int, int] = {}
    kept: list[Any] = []  # keeps objects alive, so that no id is used twice
    whole = hashlib.sha256(f"{sys.version_info.major}.{sys.version_info.minor}".encode())
    for word in _described(measure, seen, kept, 0):
        whole.update(word.encode("utf-8", "surrogatepass") + b"\0")
    return whole.hexdigest()[:16]


def _described(x: Any, seen: dict[int, int], kept: list[Any], depth: int) -> Iterator[str]:
    """Words for the digest that identify a value."""
    if x is None or isinstance(x, (bool, int, float, complex, str, bytes, np.generic, Path)):
        yield f"{type(x).__name__} {x!r}"
        return
    if id(x) in seen or depth > DEPTH:
        yield f"again {seen.get(id(x), 'deep')}"
        return
    seen[id(x)] = len(seen)
    kept.append(x)
    if isinstance(x, np.ndarray):
        yield f"array {x.dtype} {x.shape} "
        yield from (
            [hashlib.sha256(np.ascontiguousarray(x).tobytes()).hexdigest()]
            if not x.dtype.hasobject
            else map(repr, x.flat)
        )
    elif isinstance(x, (tuple, list)):
        yield f"{type(x).__name__} {len(x)}"
        for item in x:
            yield from _described(item, seen, kept, depth + 1)
    elif isinstance(x, (set, frozenset)):
        yield f"{type(x).__name__} {len(x)}"
        yield from sorted("\0".join(_described(item, dict(seen), kept, depth + 1)) for item in x)
    elif isinstance(x, Mapping):
        yield f"mapping {len(x)}"
        for key, value in x.items():
            yield from _described(key, seen, kept, depth + 1)
            yield from _described(value, seen, kept, depth + 1)
    else:
        yield from _of_object(x, seen, kept, depth)


def _of_object(x: Any, seen: dict[int, int], kept: list[Any], depth: int) -> Iterator[str]:
    """Words for the digest that identify functions, classes and objects."""
    parts: list[Any] = []
    if isinstance(x, functools.partial):
        parts = ["partial", x.func, x.args, x.keywords]
    elif isinstance(x, types.MethodType):
        parts = ["method", x.__func__, x.__self__]
    elif isinstance(x, (staticmethod, classmethod)):
        parts = [type(x).__name__, x.__func__]
    elif isinstance(x, property):
        parts = ["property", x.fget, x.fset]
    elif isinstance(x, types.FunctionType) and _is_own(x.__module__):
        parts = ["function", *_code(x.__code__, x.__doc__), x.__defaults__, x.__kwdefaults__, dict(_referred(x))]
    elif isinstance(x, type) and _is_own(x.__module__):
        own = {name: value for name, value in vars(x).items() if not name.startswith("__") or callable(value)}
        parts = ["class", x.__qualname__, x.__bases__, own]
    elif hasattr(x, "folder") and hasattr(x, "_manifest"):  # x is a solver
        parts = ["solver", package_digest(x.folder)]
    elif isinstance(digest := getattr(x, "digest", None), str) and digest:  # x is a model
        parts = [type(x).__qualname__, digest]
    elif isinstance(x, (type, types.FunctionType, types.BuiltinFunctionType, types.ModuleType)):
        parts = ["installed", getattr(x, "__module__", ""), getattr(x, "__qualname__", getattr(x, "__name__", ""))]
    else:
        parts = ["object", type(x), vars(x) if _is_own(type(x).__module__) and hasattr(x, "__dict__") else None]
    for part in parts:
        yield from _described(part, seen, kept, depth + 1)


def package_digest(folder: Path) -> str:
    """SHA-256, 16 digits, of the files with which a generated package computes."""
    whole = hashlib.sha256()
    for path in sorted(Path(folder).rglob("*")):
        if path.suffix in (".c", ".h", ".py", ".json") and "__pycache__" not in path.parts:
            whole.update(str(path.relative_to(folder)).encode() + b"\0" + path.read_bytes())
    return whole.hexdigest()[:16]


def _is_own(module: str | None) -> bool:
    """Whether a module is the user's: not in the standard library, not installed, and not part of ordernm."""
    name = (module or "").partition(".")[0]
    if name in sys.stdlib_module_names and name != "__main__":
        return False
    if name in (__name__.partition(".")[0], "ordernm"):
        return False
    file = getattr(sys.modules.get(module or ""), "__file__", None) or ""
    return not any(part in Path(file).parts for part in INSTALLED)


def _code(code: types.CodeType, docstring: str | None) -> list[Any]:
    """The content of a code object without line numbers and documentation."""
    constants: list[Any] = []
    for i, constant in enumerate(code.co_consts):
        if isinstance(constant, types.CodeType):
            constants += _code(constant, None)
        elif not (i == 0 and docstring is not None and constant == docstring):
            constants.append(constant)
    return [
        code.co_code,
        code.co_names,
        code.co_varnames,
        code.co_freevars,
        code.co_argcount,
        code.co_flags,
        *constants,
    ]


def _codes(code: types.CodeType) -> Iterator[types.CodeType]:
    """A code object, and the code objects of the functions defined in it."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, types.CodeType):
            yield from _codes(constant)


def _referred(function: types.FunctionType) -> Iterator[tuple[str, Any]]:
    """Names and values of globals and closure variables, except those that the function changes."""
    code = function.__code__
    changed = _changed(code)
    for name, cell in zip(code.co_freevars, function.__closure__ or (), strict=True):
        if name not in changed:
            try:
                yield f"closure {name}", cell.cell_contents
            except ValueError:  # a closure variable that is not assigned yet
                yield f"closure {name}", None
    used = dict.fromkeys(name for part in _codes(code) for name in part.co_names)
    for name in used:
        if name not in function.__globals__ or name in changed:
            continue
        value = function.__globals__[name]
        yield f"global {name}", value
        if isinstance(value, types.ModuleType) and _is_own(value.__name__):
            yield from ((f"{name}.{n}", vars(value)[n]) for n in used if n in vars(value))


def _changed(code: types.CodeType) -> set[str]:
    """Names outside of a function that the function assigns, or whose values it changes."""
    found = set[str]()
    for part in _codes(code):
        loads: dict[tuple[int | None, int | None], str] = {}
        for step in dis.get_instructions(part):
            at = (step.positions.lineno, step.positions.col_offset) if step.positions else (None, None)
            if step.opname in ("STORE_GLOBAL", "DELETE_GLOBAL", "STORE_DEREF", "DELETE_DEREF") and step.argval in (
                *code.co_freevars, *part.co_names,
            ):  # fmt: skip
                found.add(step.argval)
            elif step.opname in ("LOAD_GLOBAL", "LOAD_DEREF", "LOAD_NAME"):
                loads[at] = step.argval
            elif at in loads and (
                step.opname in STORES or (step.opname in ("LOAD_ATTR", "LOAD_METHOD") and step.argval in MUTATORS)
            ):
                found.add(loads[at])
    return found


__all__ = ["measure_digest", "package_digest"]
