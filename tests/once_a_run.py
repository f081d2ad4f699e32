"""Shares generated and compiled files among the processes of a run and with later runs; equal inputs give equal bytes."""

from __future__ import annotations

import hashlib
import importlib
import inspect
import io
import os
import pickle
import shutil
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from kept_files import Generator, put, used

import codegen.pipeline
import codegen.runtime.standalone.files.build
from codegen.loops.ears import Partition
from codegen.model import Model
from codegen.pipeline import Source
from codegen.program.progress import silent
from codegen.runtime.standalone.calls.caller import CallerBuild
from codegen.runtime.standalone.files.build import Build, _texts
from codegen.runtime.standalone.files.compiler import Stop, find_compiler, processor

SMALL = 20_000
"""Bytes of sources and what they include that are compiled each time: tests of compiling itself write them by hand."""


@contextmanager
def compiled_once(kept: Path) -> Iterator[None]:
    """Libraries, and the compiled part of calls, are copied from a folder if sources, flags and compiler are the same.

    With -O0, clang compiles large sources if it is there and ``CC`` names no compiler: it takes two thirds of gcc's time.
    It compiles a library as one unit: reading the sources again for a second unit takes as long as compiling the first.
    The compiler that users have links them, because starting clang takes three times as long as linking.
    """
    compile_anew, run_anew = Build._compile, codegen.runtime.standalone.files.build.run_all
    clang = shutil.which("clang")

    def run_or_link(commands: list[list[str]], stop: Stop) -> tuple[bool, str]:
        linking = [c for c in commands if c[0] == clang and not any(part.endswith(".c") for part in c)]
        return run_anew([[*find_compiler(), *c[1:]] if c in linking else c for c in commands], stop)

    def compile_or_copy(build: Build, output: Path, log_file: Path) -> None:
        small = sum(map(len, _texts(build.sources))) < SMALL
        if type(build) is not CallerBuild and (type(build) is not Build or small):
            return compile_anew(build, output, log_file)
        given = build.compiler, build.units
        if clang and "-O0" in build.flags and not os.environ.get("CC"):
            build.compiler, build.units = [clang], ()
        try:
            library = kept / f"{build.key()}.so"
            if used(library):
                shutil.copyfile(library, output)
                log_file.unlink(missing_ok=True)
                return None
            compile_anew(build, output, log_file)
            put(library, output.read_bytes())
        finally:
            build.compiler, build.units = given
        return None

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Build, "_compile", compile_or_copy)
        patch.setattr(codegen.runtime.standalone.files.build, "run_all", run_or_link)
        yield


@contextmanager
def written_once(kept: Path, generator: Generator, anew: Callable[[], bool]) -> Iterator[None]:
    """`codegen.generate` takes the text of a solver from a folder where model and options are alike, unless `anew()`.

    Callers of `write_solver` itself write it, and so does whoever follows the progress, for those that come later.
    """
    write_anew = codegen.pipeline.write_solver
    signature = inspect.signature(write_anew)

    def write_or_read(*arguments: Any, **options: Any) -> Source:
        call = signature.bind(*arguments, **options)
        call.apply_defaults()
        asked = call.arguments
        printed = asked.pop("printed")
        followed = asked.pop("progress") is not silent
        if anew():
            return write_anew(*arguments, **options)
        file = kept / f"{digest([generator.key, processor(), {n: part(x) for n, x in asked.items()}])}.source"
        if not followed and used(file):
            source: Source = pickle.loads(zlib.decompress(file.read_bytes()))
            if printed is not None:
                printed(source.files, source.manifest)
            return source
        source = write_anew(*arguments, **options)
        if generator.unchanged():
            put(file, zlib.compress(pickle.dumps(without_statements(source)), 1))
        return source

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(codegen.pipeline, "write_solver", write_or_read)
        yield


@contextmanager
def chosen_once(kept: Path, generator: Generator, anew: Callable[[], bool]) -> Iterator[None]:
    """The dependents of a mechanism are chosen once for the generator and all engines, unless `anew()`."""
    module = importlib.import_module("codegen.loops.partition")
    choose_anew = module._found
    known: dict[str, Partition] = {}

    def choose_or_remember(model: Model, *geometry: Any) -> Partition:
        if anew():
            return choose_anew(model, *geometry)
        key = digest([generator.key, processor(), part(model)])
        if key not in known:
            file = kept / f"{key}.partition"
            if used(file):
                known[key] = pickle.loads(file.read_bytes())
            else:
                known[key] = choose_anew(model, *geometry)
                if generator.unchanged():
                    put(file, pickle.dumps(known[key]))
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "_found", choose_or_remember)
        yield


@contextmanager
def noticing_patches(replacing: set[int]) -> Iterator[None]:
    """Fills a set while a test or a fixture replaces anything but environment variables; earlier replacements do not count."""

    def noticed(name: str, of_entries: bool) -> Callable[..., Any]:
        replace_ = getattr(pytest.MonkeyPatch, name)

        def method(patch: pytest.MonkeyPatch, target: Any, *arguments: Any, **options: Any) -> Any:
            if not of_entries or target is not os.environ:
                replacing.add(id(patch))
            return replace_(patch, target, *arguments, **options)

        return method

    undo_ = pytest.MonkeyPatch.undo

    def undo(patch: pytest.MonkeyPatch) -> None:
        undo_(patch)
        replacing.discard(id(patch))

    ways = {"setattr": False, "delattr": False, "setitem": True, "delitem": True}
    with pytest.MonkeyPatch.context() as patch:
        for name, method in {n: noticed(n, of_entries) for n, of_entries in ways.items()}.items():
            patch.setattr(pytest.MonkeyPatch, name, method)
        patch.setattr(pytest.MonkeyPatch, "undo", undo)
        replacing.clear()
        yield


def part(value: Any) -> Any:
    """The part of a value on which a solver depends; for a model, without line numbers and computed data."""
    return [getattr(value, f.name) for f in fields(value) if f.compare] if isinstance(value, Model) else value


def digest(value: Any) -> str:
    """Equal for equal values, even if they share objects differently."""
    written = io.BytesIO()
    pickler = pickle.Pickler(written)
    pickler.fast = True
    pickler.dump(value)
    return hashlib.sha256(written.getbuffer()).hexdigest()


def without_statements(source: Source) -> Source:
    """The parts of a source that `codegen.generate` needs."""
    system, program = source.system, source.program
    given: dict[str, Any] = {f.name: getattr(source, f.name) for f in fields(source)} | {
        "system": SimpleNamespace(
            model=replace(system.model), links=range(len(system.links)), kinds=range(len(system.kinds))
        ),
        "program": SimpleNamespace(sweep_seconds=program.sweep_seconds),
    }
    return Source(**given)
