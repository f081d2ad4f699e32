"""Sizes of compiled C functions: bytes of code and of stack, from the compiler's object file and its call graph."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from ..runtime.standalone.errors import CompileError
from ..runtime.standalone.files.compiler import compile_seconds, find_compiler

FLAGS = ("-std=c99", "-O2", "-DORDERNM_PLAIN_C")
"""Compiler flags of the build whose sizes are measured."""

NODE = re.compile(r'^node: \{ title: "([^"]+)" label: "([^"]*)"')
EDGE = re.compile(r'^edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"')
STACK = re.compile(r"(\d+) bytes \((static|dynamic(?:,bounded)?)\)")
SYMBOL = re.compile(r"^\w+ (\w+) [tT] ([\w.]+)$", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Size:
    """The size of a function with all functions that it calls, without those of the C library.

    Attributes
    ----------
    code : int
        Bytes of code.
    stack : int or None
        Largest number of bytes on the stack; None if the compiler does not report it.
    """

    code: int
    stack: int | None


@dataclass(frozen=True, slots=True)
class Build:
    """A measured build.

    Attributes
    ----------
    compiler : str
        Command and flags.
    sizes : dict of str to Size
        Sizes by function.
    library : tuple of str
        Functions of the C library that are called.
    """

    compiler: str
    sizes: dict[str, Size]
    library: tuple[str, ...]


def measured(files: Mapping[str, str], source: str, functions: Iterable[str]) -> Build:
    """Compiles a C file with `CC`, and measures functions.

    Parameters
    ----------
    files : mapping of str to str
        The file and its headers, by name.
    source : str
        Name of the file.
    functions : iterable of str

    Raises
    ------
    NoCompilerError, CompileError
    """
    command = find_compiler()
    with tempfile.TemporaryDirectory(prefix="ordernm-") as name:
        folder = Path(name)
        for file, text in files.items():
            (folder / file).write_text(text, encoding="utf-8")
        build = [*command, *FLAGS, "-c", source, "-o", "object.o"]
        done = _run([*build, "-fcallgraph-info=su"], folder)
        if done.returncode:  # not gcc
            done = _run(build, folder)
        if done.returncode:
            raise CompileError(f"{' '.join(build)} failed in the export:\n{done.stderr[-2000:]}")
        nm = _run([*command, "-print-prog-name=nm"], folder).stdout.strip() or "nm"
        listed = _run([shutil.which(nm) or "nm", "-S", "object.o"], folder).stdout
        code = {symbol: int(size, 16) for size, symbol in SYMBOL.findall(listed)}
        graph = next((file.read_text(encoding="utf-8") for file in folder.glob("*.ci")), "")
    stacks, calls = _call_graph(graph)
    sizes = {}
    for function in functions:
        reached = _reached(function, calls)
        bytes_of_code = sum(code.get(f, 0) for f in (reached if calls else code))
        sizes[function] = Size(bytes_of_code, _deepest(function, stacks, calls) if stacks else None)
    library = sorted({f for called in calls.values() for f in called if f not in stacks})
    return Build(f"{Path(command[0]).name} {' '.join([*command[1:], *FLAGS])}", sizes, tuple(library))


def _run(command: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command,
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=compile_seconds(),
        stdin=subprocess.DEVNULL,
    )


def _call_graph(text: str) -> tuple[dict[str, int], dict[str, set[str]]]:
    """Bytes on the stack of each function, and the functions that it calls, from gcc's graph."""
    stacks: dict[str, int] = {}
    calls: dict[str, set[str]] = {}
    for line in text.splitlines():
        if node := NODE.match(line):
            stack = STACK.search(node[2])
            if stack:
                stacks[_name(node[1])] = int(stack[1])
                calls.setdefault(_name(node[1]), set())
        elif edge := EDGE.match(line):
            calls.setdefault(_name(edge[1]), set()).add(_name(edge[2]))
    return stacks, calls


def _name(title: str) -> str:
    """The name of the function of a node; for static functions, the file name precedes it."""
    return title.rpartition(":")[2]


def _reached(function: str, calls: Mapping[str, set[str]]) -> set[str]:
    found, left = {function}, [function]
    while left:
        new = calls.get(left.pop(), set()) - found
        found |= new
        left += new
    return found


def _deepest(function: str, stacks: Mapping[str, int], calls: Mapping[str, set[str]]) -> int:
    """Bytes on the stack along the deepest chain of calls; no generated function calls itself."""
    below = [_deepest(f, stacks, calls) for f in calls.get(function, ()) if f in stacks]
    return stacks.get(function, 0) + max(below, default=0)
