"""Generate a solver: expand the model, write the package, compile it, check it against the generic engine."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import math
import os
import re
import secrets
import shutil
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .model import Model, ModelError, load_model
from .version import __version__

LAYOUTS = ("auto", "kinds", "unrolled")
TARGETS = ("c", "numpy", "both")
CHECK_TOLERANCE = 1e-9
CHECK_STATES = 3
CHECK_DRAWS = 12
"""So many random states are drawn to find those where the model's expressions have a value."""
CHECK_LIMIT = 200
"""Models of more bodies are not checked against the generic engine, which is slow."""


class FolderError(ValueError):
    """The output folder cannot be written, or holds something that `generate` did not write."""


@dataclass(slots=True)
class Report:
    """What `generate` did.

    Attributes
    ----------
    folder : Path
    files : dict of str to int
        Bytes of every file.
    links, kinds : int
    operations : dict
        By sweep; see `Solver.operations`.
    passes : list of (str, dict, float)
        Operations of all blocks after every pass, and seconds.
    sweep_seconds : dict of str to float
        Expanding and simplifying, by sweep.
    seconds : dict of str to float
        By stage.
    errors : dict of str to float
        Largest relative errors of the check: of udot, and of its derivative per direction.
    remarks : list of str
        What was left out, and why.
    loops : list of str
        The choice made for closed loops, in words: ears, dependents, ranks, degrees of freedom.
    written : bool
        False: the folder held these very files already.
    """

    folder: Path
    name: str
    target: str
    layout: str
    bodies: int
    links: int
    kinds: int
    nq: int
    nu: int
    parameters: int
    files: dict[str, int]
    operations: dict[str, Any]
    passes: list[tuple[str, dict[str, int], float]]
    sweep_seconds: dict[str, float]
    warnings: tuple[str, ...]
    seconds: dict[str, float] = field(default_factory=dict)
    compiled: bool = False
    errors: dict[str, float] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)
    loops: list[str] = field(default_factory=list)
    written: bool = True

    def flops(self, *sweeps: str, per: str = "per_call") -> int:
        """Additions, multiplications and divisions of sweeps together."""
        return sum(
            count
            for s in sweeps
            if s in self.operations
            for name, count in self.operations[s][per].items()
            if name != "functions"
        )


def generate(
    model: Model | str | os.PathLike[str],
    folder: str | os.PathLike[str] | None = None,
    target: str = "c",
    layout: str = "auto",
    *,
    partitions: int = 1,
    reactions: bool = False,
    compile: bool = True,
    check: bool = False,
) -> Report:
    """Write the solver of a model.

    Parameters
    ----------
    model : Model or path
    folder : path, optional
        The package to write, ``generated/<name>`` if left out. It may hold an earlier output, nothing else.
    target : {"c", "numpy", "both"}
        What the package's `Solver` uses. Both are always written.
    layout : {"auto", "kinds", "unrolled"}
        One C function per kind of link called in loops, or one per link; "auto" takes the second for small models.
    partitions : {1, 2}
        With 2, and where another choice of independent coordinates closes the loops, the package holds both; see
        `Solver.use_partition`.
    reactions : bool
        The solver has `Solver.reactions`: what joints and loops transmit.
    compile, check : bool
        Compile now; compare with `codegen.reference.RecursiveEngine` at three random states.

    Returns
    -------
    Report

    Raises
    ------
    ModelError
        The model is wrong; nothing has been written.
    FolderError
        The folder cannot be written, or holds something that `generate` did not write.
    CompileError
        The C compiler failed; the package stays, with the compiler's log.
    """
    if target not in TARGETS:
        raise ValueError(f"target is {target!r}; allowed are {', '.join(TARGETS)}")
    if layout not in LAYOUTS:
        raise ValueError(f"layout is {layout!r}; allowed are {', '.join(LAYOUTS)}")
    if partitions not in (1, 2):
        raise ValueError(f"partitions is {partitions!r}; allowed are 1 and 2")
    seconds: dict[str, float] = {}
    origin = None
    with _timed(seconds, "read"):
        if not isinstance(model, Model):
            file = Path(model)
            model = load_model(file)
            origin = {"file": file.name, "sha256": hashlib.sha256(file.read_bytes()).hexdigest()}
    path = (Path("generated") / model.name if folder is None else Path(folder)).absolute()
    refuse_foreign(path)

    from .emit.solver import write_solver

    try:
        source = write_solver(model, layout, reactions=reactions)
    except ModelError as error:
        if origin is None:
            raise
        raise ModelError([dataclasses.replace(p, file=str(file)) for p in error.problems]) from None
    seconds |= source.seconds
    if partitions == 2 and source.chosen is not None:
        with _timed(seconds, "second partition"):
            add_second(model, layout, source, reactions)
    with _timed(seconds, "write"):
        files = source.files | package_files(source, target, origin)
        written = write_folder(path, files)
    report = Report(
        folder=path, name=model.name, target=target, layout=source.layout, bodies=len(model.bodies),
        links=len(source.system.links), kinds=len(source.system.kinds), nq=model.nq, nu=model.nu,
        parameters=len(model.parameters), files={name: len(text.encode()) for name, text in sorted(files.items())},
        operations=source.manifest["operations"],
        passes=[(n, {"additions": o.additions, "multiplications": o.multiplications, "divisions": o.divisions,
                     "functions": o.functions}, s) for n, o, s in source.passes],
        sweep_seconds=source.program.sweep_seconds,
        warnings=model.warnings, seconds=seconds, loops=source.choice, written=written,
    )  # fmt: skip
    if compile and target != "numpy":
        from .runtime.solver import NoCompilerError, compile_library

        with _timed(seconds, "compile"):
            try:
                for name in (model.name, *([f"{model.name}{SECOND}"] if "second" in source.manifest else [])):
                    compile_library(path, name)
                report.compiled = True
            except NoCompilerError as error:
                report.remarks.append(f"{error}; the NumPy target (--target numpy) serves until then, more slowly")
    if check:
        with _timed(seconds, "check"):
            check_solver(model, report)
    return report


SECOND = "_second"
"""What the names of files and C functions of a second partition have after the model's."""


def add_second(model: Model, layout: str, source: Any, reactions: bool) -> None:
    """Add the solver of a second partition to the files and the manifest of the first."""
    from .emit.solver import write_solver
    from .loops.alternatives import second_partition

    found = second_partition(model, source.chosen)
    if found is None:
        source.choice.append("no second partition: no other choice of independent coordinates closes the loops")
        return
    second = write_solver(dataclasses.replace(model, name=f"{model.name}{SECOND}"), layout, found, reactions)
    source.files |= second.files
    source.manifest["second"] = second.manifest
    source.choice += ["second partition:", *second.choice]


@contextlib.contextmanager
def _timed(seconds: dict[str, float], stage: str) -> Iterator[None]:
    start = time.perf_counter()
    try:
        yield
    finally:
        seconds[stage] = time.perf_counter() - start


def package_files(source: Any, target: str, origin: dict[str, str] | None) -> dict[str, str]:
    """The files of a package beside the solver's source; `origin` is the model file, if there is one."""
    from .emit.templates import render

    digest = hashlib.sha256()
    for name, text in sorted(source.files.items()):
        digest.update(f"{name}\0{text}\0".encode())
    own = ["README.md", "__init__.py", "_runtime.py", "model.json"]
    manifest = {
        "generator": "ordernm",
        "version": __version__,
        "origin": origin,
        "hash": digest.hexdigest(),
        "files": sorted([*source.files, *own]),
        "target": target,
        "layout": source.layout,
        **source.manifest,
    }
    context = {"manifest": manifest, "name": manifest["name"], "NAME": manifest["name"].upper(), "version": __version__}
    runtime = (Path(__file__).parent / "runtime" / "solver.py").read_text(encoding="utf-8")
    return {
        "model.json": json.dumps(manifest, indent=1) + "\n",
        "__init__.py": render("package/init.py.jinja", context),
        "README.md": render("package/README.md.jinja", context),
        "_runtime.py": runtime,
    }


def refuse_foreign(folder: Path) -> None:
    """Raise `FolderError` unless the folder is absent, empty, or an earlier output and nothing else."""
    if not folder.exists():
        return
    if not folder.is_dir():
        raise FolderError(f"{folder} is a file; give a folder to write into with -o")
    here = Path.cwd()
    if folder.resolve() in (here, *here.parents):  # the folder is replaced as a whole: the shell would stand in nothing
        raise FolderError(f"{folder} is, or holds, the working directory; give a folder of its own with -o")
    found = {p.name for p in folder.iterdir()}
    if not found:
        return
    manifest: Any = None
    with contextlib.suppress(OSError, ValueError):
        manifest = json.loads((folder / "model.json").read_text(encoding="utf-8"))
    if not isinstance(manifest, dict) or manifest.get("generator") != "ordernm":
        raise FolderError(
            f"{folder} holds something that generate did not write; choose another folder with -o, or empty this one"
        )
    own = re.compile(
        rf"{re.escape(str(manifest.get('name')))}({SECOND})?(-[0-9a-f-]+\.so|\.log)|__pycache__|\.build-.*"
    )
    foreign = sorted(n for n in found - set(manifest.get("files", ())) if not own.fullmatch(n))
    if foreign:
        raise FolderError(
            f"{folder} holds beside generated files {', '.join(foreign[:5])}{', ...' if len(foreign) > 5 else ''}, which "
            f"writing anew would lose; move that away, or choose another folder with -o"
        )


def write_folder(folder: Path, files: dict[str, str]) -> bool:
    """Write a package as a whole: it is complete beside its place before it takes it.

    A folder that holds these very files stays as it is, with its compiled library: False is returned. Where only other
    files than the C have changed, libraries are taken along.
    """
    folder = folder.resolve()  # a link to a folder stays one
    new = {name: text.encode() for name, text in files.items()}
    with contextlib.suppress(OSError):
        if all((folder / name).read_bytes() == content for name, content in new.items()):
            return False
    aside = f"{os.getpid()}-{secrets.token_hex(4)}"
    temporary = folder.with_name(f".{folder.name}-new-{aside}")
    old = folder.with_name(f".{folder.name}-old-{aside}")
    try:
        temporary.mkdir(parents=True)
        for name, content in new.items():
            (temporary / name).write_bytes(content)
        _keep_libraries(folder, temporary)
        _take_place(temporary, folder, old)
        return True
    except OSError as error:
        raise FolderError(f"cannot write {folder}: {error.strerror or error}") from None
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _take_place(new: Path, folder: Path, old: Path) -> None:
    """Put a finished folder where another may stand, also while other processes do the same."""
    for attempt in range(20):
        with contextlib.suppress(FileNotFoundError):
            os.rename(folder, old)
        try:
            os.rename(new, folder)
        except OSError:
            with contextlib.suppress(OSError):
                os.rename(old, folder)
            if attempt == 19:
                raise
            time.sleep(0.01)
        else:
            return
        finally:
            shutil.rmtree(old, ignore_errors=True)


def _keep_libraries(old: Path, new: Path) -> None:
    """Take compiled libraries along where the C has not changed."""
    for source in new.glob("*.[ch]"):
        before = old / source.name
        if not before.is_file() or before.read_bytes() != source.read_bytes():
            return
    for library in old.glob("*.so"):
        with contextlib.suppress(OSError):
            shutil.copy2(library, new / library.name)


def check_solver(model: Model, report: Report) -> None:
    """Compare the written solver with the generic engine at three random states; fills `Report.errors`."""
    if len(model.bodies) > CHECK_LIMIT:
        report.remarks.append(f"not checked against the generic engine: more than {CHECK_LIMIT} bodies")
        return
    import numpy as np

    from .reference import RecursiveEngine
    from .runtime import AssemblyError, SingularLoopError, load

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a missing compiler has been told
        solver = load(report.folder)
    engine = RecursiveEngine(model)
    rng = np.random.default_rng(1)
    unchecked = "warning: not checked against the generic engine: "
    try:
        q0, u0 = solver.initial
    except SingularLoopError as singular:
        report.remarks.append(f"{unchecked}at the initial configuration {singular}")
        return
    errors = {"udot": 0.0, "dudot": 0.0}
    checked = 0
    why = "the accelerations are not finite"
    for _ in range(CHECK_DRAWS):
        q = q0 + (0.05 if model.loops else 0.5) * rng.normal(size=solver.nq)
        u = u0 + rng.normal(size=solver.nu)
        if model.loops:
            try:
                q, u = solver.assemble(q, u)
            except (AssemblyError, SingularLoopError) as open_loop:
                why = f"none of them can be assembled, the last because {open_loop}"
                continue
        inputs, t = rng.normal(size=solver.ninputs), float(rng.uniform(0.1, 1.0))
        sizes = {"dq": solver.nq, "du": solver.nu, "dp": solver.np, "dinputs": solver.ninputs}
        seeds = {name: rng.normal(size=(3, n)) for name, n in sizes.items()} | {"dt": rng.normal(size=3)}
        with np.errstate(all="ignore"):
            try:
                given = solver.sensitivities(q, u, None, inputs, t, **seeds)
            except SingularLoopError as singular:
                why = f"loops lose rank, the last because {singular}"
                continue
            expected = [np.asarray(x) for x in engine.sensitivities(q, u, None, inputs, t, **seeds)]
        if not all(np.isfinite(x).all() for x in expected):
            continue  # a force such as log(q.a - 1) has no value there: nothing to compare with
        for name, x, y in zip(("udot", "dudot"), given, expected, strict=True):
            for a, b in zip(np.atleast_2d(x), np.atleast_2d(y), strict=True):
                error = float(np.max(np.abs(a - b), initial=0.0)) / max(float(np.max(np.abs(b), initial=0.0)), 1e-6)
                errors[name] = max(errors[name], error) if error == error else math.inf
        checked += 1
        if checked == CHECK_STATES:
            break
    if checked:
        report.errors = errors
    else:
        report.remarks.append(
            f"{unchecked}of {CHECK_DRAWS} random states near the initial one {why}; give other initial values"
        )
