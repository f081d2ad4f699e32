"""Generates a solver: expands the model, writes the package, compiles it, compares it with the generic engine."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import math
import os
import time
import warnings
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .c_interface import package_context
from .folders import OTHERS, FolderError, put_right, refuse_foreign, write_folder
from .listing import list_model
from .model import Model, ModelError, load_model
from .program.progress import Progress, silent
from .summary import Report
from .terminal import with_status
from .version import __version__

if TYPE_CHECKING:
    from .compiling_ahead import CompilingAhead
    from .reference import RecursiveEngine
    from .runtime import Solver

LAYOUTS = ("auto", "kinds", "unrolled")
TARGETS = ("c", "numpy", "both")
CHECK_STATES = 3
CHECK_DRAWS = 12
"""Maximum number of random states that are drawn to find `CHECK_STATES` states with defined forces."""
CHECK_LIMIT = 200
"""Largest number of bodies of a model that is compared with the generic engine, which is slow."""


@with_status()
def generate(
    model: Model | str | os.PathLike[str],
    folder: str | os.PathLike[str] | None = None,
    target: str = "c",
    layout: str = "auto",
    *,
    partitions: int = 1,
    reactions: bool = False,
    frames: bool = False,
    functions: Sequence[str] | str | None = None,
    scalar: str = "float64",
    compile: bool | str = True,
    check: bool = False,
    progress: Progress | None = None,
    force: bool = False,
) -> Report:
    """Generate the solver of a model: write the package, compile it, and check it on request.

    Parameters
    ----------
    model : Model or path
        The model, or its file.
    folder : path, optional
        The package to write. Default: ``generated/NAME``. It may hold an earlier package; anything else needs `force`.
    target : {"c", "numpy", "both"}, optional
        The code that the package's `Solver` runs. Both are always written.
    layout : {"auto", "kinds", "unrolled"}, optional
        One C function for each kind of link, called in loops, or one for each link. "auto" chooses "unrolled" for small
        models.
    partitions : {1, 2, 3, 4}, optional
        Number of choices of independent coordinates that the package holds; fewer if no further choice is found. See
        `Solver.use_partition`.
    reactions : bool, optional
        Include `Solver.reactions` and `Solver.reaction_sensitivities`. If `functions` are chosen, derivatives are
        included only if `functions` name them.
    frames : bool, optional
        Include `Solver.frames`, `Solver.points` and their derivatives.
    functions : sequence of str, or str with commas, optional
        Functions that the solver has: names of its methods, such as ``("accelerations", "gradients")``, or of groups,
        such as ``"dynamics"``, ``"rates"``, ``"mass"``, ``"forces"``, ``"states"``, ``"frames"``. Default: all. The
        methods that make states consistent are always included.
    scalar : {"float64", "float32"}, optional
        Scalar type of the C, its arrays and results. With "float32" `Solver.simulate` and `Solver.judge` are absent,
        and methods that iterate, such as `Solver.assemble`, compute in double precision and round.
    compile : bool or "all", optional
        Compile accelerations and sensitivities now, and other functions at their first call. "all" compiles everything
        now, for a machine without a compiler.
    check : bool, optional
        Compare the solver with `codegen.reference.RecursiveEngine` at three random states.
    progress : callable, optional
        Called as ``progress(stage, step, steps)`` at the beginning of each step; the stage is a word such as
        ``"expanding"``, the steps are ``0, 0`` where they are not counted. An exception from it ends the work and
        leaves nothing half-written.
    force : bool, optional
        Write also into a folder that holds other files: files of the same names are replaced, others stay.

    Returns
    -------
    Report
        What was written, its cost, warnings and remarks. It prints as text.

    Raises
    ------
    ModelError
        If the model is wrong. Nothing is written.
    UnknownFunctionError
        A ValueError, if `functions` has an unknown name. It lists the allowed ones.
    FolderError
        If the folder cannot be written, or holds files that `generate` did not write.
    CompileError
        If the C compiler fails. The package stays, with the compiler's log.
    NoCompilerError
        If there is no C compiler and `compile` is "all". The package stays.

    Examples
    --------
    >>> report = ordernm.generate("examples/double_pendulum.yaml", "double_pendulum", compile=False)
    >>> report.nq, report.nu, report.parameters
    (2, 2, 6)
    """
    # long: the docstring describes every argument
    from .emit.c import C

    scalars = [s.name for s in C.scalars]
    for name, value, allowed in (("target", target, TARGETS), ("layout", layout, LAYOUTS), ("scalar", scalar, scalars)):
        if value not in allowed:
            raise ValueError(f"{name} is {value!r}; allowed are {', '.join(allowed)}")
    check_flags(reactions=reactions, frames=frames, check=check, force=force)
    if not isinstance(compile, bool) and compile != "all":
        raise ValueError(f"compile is {compile!r}; allowed are True, False and 'all'")
    functions = names_of(functions)
    if scalar != scalars[0] and target != "c":
        raise ValueError(
            f"scalar is {scalar!r}, which only the C target supports; target is {target!r}, but must be 'c'"
        )
    if isinstance(partitions, bool) or partitions not in range(1, len(OTHERS) + 2):
        raise ValueError(f"partitions is {partitions!r}; allowed are 1 to {len(OTHERS) + 1}")
    progress = progress or silent
    seconds: dict[str, float] = {}
    origin = None
    progress("reading", 0, 0)
    with _timed(seconds, "read"):
        if not isinstance(model, Model):
            given, model = model, load_model(model)
            file = Path(given)
            origin = {"file": file.name}
            if file.is_file():  # a pipe can be read only once
                origin["sha256"] = model.digest
    path = (Path("generated") / model.name if folder is None else Path(folder)).absolute()
    put_right(path)
    keep = refuse_foreign(path, force)

    from .compiling_ahead import CompilingAhead
    from .pipeline import write_solver

    chosen: dict[str, Any] = {
        "reactions": reactions, "progress": progress, "functions": functions, "frames": frames, "scalar": scalar,
    }  # fmt: skip
    with CompilingAhead(path, compile == "all") as ahead:
        try:
            printed = ahead.begin if compile and target != "numpy" else None
            source = write_solver(model, layout, printed=printed, **chosen)
        except ModelError as error:
            if origin is None:
                raise
            raise ModelError([dataclasses.replace(p, file=str(file)) for p in error.problems]) from None
        seconds |= source.seconds
        alone = partitions > 1 and source.chosen is None
        if partitions > 1 and not alone:
            with _timed(seconds, "other partitions"):
                add_others(model, layout, source, partitions, **chosen)
        progress("writing", 0, 0)
        with _timed(seconds, "write"):
            source.manifest["description"] = [*list_model(model), *(f"  {line}" for line in source.choice)]
            files = source.files | package_files(source, target, origin)
            written = write_folder(path, files, keep)
        report = Report(
            folder=path, name=model.name, target=target, layout=source.layout, bodies=len(model.bodies),
            links=len(source.system.links), kinds=len(source.system.kinds), nq=model.nq, nu=model.nu,
            parameters=len(model.parameters), files={name: len(text.encode()) for name, text in sorted(files.items())},
            operations=source.manifest["operations"],
            sweeps={name: f["sweeps"] for name, f in source.manifest["functions"].items()},
            passes=[(n, {"additions": o.additions, "multiplications": o.multiplications, "divisions": o.divisions,
                         "functions": o.functions}, s) for n, o, s in source.passes],
            sweep_seconds=source.program.sweep_seconds,
            agreement=C.scalar(scalar).agreement, warnings=model.warnings, seconds=seconds, loops=source.choice, written=written,
        )  # fmt: skip
        if alone:
            report.remarks.append(
                f"partitions: {model.name} has no closed loops, so there is one choice of independent coordinates, "
                f"not {partitions}"
            )
        if compile and target != "numpy":
            with _timed(seconds, "compile"):
                _compile(path, [source.manifest, *source.manifest.get("others", ())], ahead, report, progress)
    if check:
        progress("checking", 0, 0)
        with _timed(seconds, "check"):
            check_solver(model, report)
    return report


def check_flags(**flags: object) -> None:
    """Raises ValueError for options that are neither True nor False: the text ``"no"`` would count as true."""
    for name, value in flags.items():
        if not isinstance(value, bool):
            raise ValueError(f"{name} is {value!r}; allowed are True and False")


def _compile(
    path: Path, parts: Sequence[dict[str, Any]], ahead: CompilingAhead, report: Report, progress: Progress
) -> None:
    """Compiles every partition; of the first partition, only libraries that were not compiled ahead."""
    from .runtime.standalone.errors import NoCompilerError
    from .runtime.standalone.files.build import first_build

    try:
        for step, part in enumerate(parts, 1):
            progress("compiling", step, len(parts))
            if step == 1:
                ahead.place()
            first_build(path, part, ahead.everything, further=step > 1).library()
        report.compiled = True
    except NoCompilerError as error:
        if ahead.everything:
            raise
        report.remarks.append(f"{error}; the NumPy target (--target numpy) is used until then; it is slower")


def add_others(
    model: Model, layout: str, source: Any, partitions: int, progress: Progress = silent, **chosen: Any
) -> None:
    """Adds the solvers of other partitions, `partitions` in all, to the files and the manifest of the first solver.

    Parameters
    ----------
    chosen
        Further arguments of `write_solver`.
    """
    from .loops.alternatives import other_partition
    from .pipeline import write_solver

    known = [source.chosen]
    for suffix in OTHERS[: partitions - 1]:
        word = suffix.removeprefix("_")
        progress("choosing other independent coordinates", 0, 0)
        found = other_partition(model, known)
        if found is None:
            source.choice.append(f"no {word} partition: no other choice of independent coordinates closes the loops")
            return
        known.append(found)
        renamed = dataclasses.replace(model, name=f"{model.name}{suffix}")
        other = write_solver(renamed, layout, found, progress=progress, **chosen)
        source.files |= other.files
        source.manifest.setdefault("others", []).append(other.manifest)
        source.choice += [f"{word} partition:", *other.choice]


@contextlib.contextmanager
def _timed(seconds: dict[str, float], stage: str) -> Iterator[None]:
    start = time.perf_counter()
    try:
        yield
    finally:
        seconds[stage] = time.perf_counter() - start


def package_files(source: Any, target: str, origin: dict[str, str] | None) -> dict[str, str]:
    """The files of a package, except the solver's source, by name. `origin` is the model file, if there is one."""
    from .emit.repetition import json_text
    from .emit.templates import render
    from .runtime.sections import carried_files
    from .runtime.standalone.files.manifest import file_digest, seal
    from .runtime.stub import stub_context

    digest = hashlib.sha256()
    for name, text in sorted(source.files.items()):
        digest.update(f"{name}\0{text}\0".encode())
    model = source.system.model
    header = f"{model.name}_model.h"
    runtime = carried_files(source.manifest)
    own = ["README.md", "__init__.py", "__init__.pyi", "py.typed", "model.json", header, *runtime]
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
    context = {
        "name": model.name, "NAME": model.name.upper(), "version": __version__,
        **package_context(model, manifest),
    }  # fmt: skip
    made = {
        "__init__.py": render("package/init.py.jinja", context),
        "__init__.pyi": render("package/init.pyi.jinja", context | stub_context(manifest)),
        "py.typed": "\n",
        "README.md": render("package/README.md.jinja", context),
        header: render("package/model.h.jinja", context),
        **runtime,
    }
    manifest["digests"] = {
        n: file_digest(t.encode()) for n, t in sorted((source.files | made).items()) if n != "README.md"
    }
    return made | {"model.json": seal(json_text(manifest))}


def names_of(functions: object) -> list[str] | None:
    """The names of the selected functions as a list; None, if all are selected."""
    if functions is None:
        return None
    if isinstance(functions, str):
        return [name.strip() for name in functions.split(",")]
    found = []
    for name in functions if isinstance(functions, Iterable) and not isinstance(functions, bytes) else [functions]:
        if not isinstance(name, str):
            raise ValueError(f"functions contains {name!r}, expected names such as ('accelerations', 'gradients')")
        found.append(name)
    return found


def check_solver(model: Model, report: Report) -> None:
    """Compares the generated solver with the generic engine at three random states; sets `Report.errors`."""
    if len(model.bodies) > CHECK_LIMIT:
        report.remarks.append(f"not checked against the generic engine: more than {CHECK_LIMIT} bodies")
        return
    import numpy as np

    from .reference import RecursiveEngine
    from .runtime import AssemblyError, SingularJointError, load

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a missing compiler has been reported already
        solver = load(report.folder)
    if not {"sensitivities", "accelerations"} & solver.operations.keys():
        report.remarks.append(
            "not checked against the generic engine: generated without accelerations and sensitivities"
        )
        return
    unchecked = "warning: not checked against the generic engine: "
    try:
        initial = solver.initial
    except (AssemblyError, SingularJointError) as singular:  # a joint, a loop or a force is singular there
        report.remarks.append(f"{unchecked}at the initial configuration {singular}")
        return
    engine, rng = RecursiveEngine(model), np.random.default_rng(1)
    found: list[dict[str, float]] = []
    why = "the accelerations are not finite"
    for _ in range(CHECK_DRAWS):
        errors = _errors(model, solver, engine, *_drawn(model, solver, initial, rng))
        if isinstance(errors, str):
            why = errors or why
        else:
            found.append(errors)
        if len(found) == CHECK_STATES:
            break
    if found:
        report.errors = {name: max(errors[name] for errors in found) for name in found[0]}
    else:
        report.remarks.append(
            f"{unchecked}at {CHECK_DRAWS} random states near the initial one, {why}; give other initial values"
        )


def _drawn(model: Model, solver: Solver, initial: Any, rng: Any) -> tuple[tuple[Any, ...], dict[str, Any]]:
    """A random state near the initial one, possibly with open loops, and seeds of three directions."""
    q0, u0 = initial
    q = q0 + (0.05 if model.loops else 0.5) * rng.normal(size=solver.nq)
    u = u0 + rng.normal(size=solver.nu)
    inputs, t = rng.normal(size=solver.ninputs), float(rng.uniform(0.1, 1.0))
    sizes = {"dq": solver.nq, "du": solver.nu, "dp": solver.np, "dinputs": solver.ninputs}
    seeds = {name: rng.normal(size=(3, n)) for name, n in sizes.items()} | {"dt": rng.normal(size=3)}
    return (q, u, None, inputs, t), seeds


def _errors(
    model: Model, solver: Solver, engine: RecursiveEngine, state: tuple[Any, ...], seeds: dict[str, Any]
) -> dict[str, float] | str:
    """Largest relative errors at a state, or the reason why they cannot be computed; empty text if a force is
    undefined."""
    import numpy as np

    from .runtime import AssemblyError, SingularJointError

    q, u, _, inputs, t = state
    if model.loops:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", RuntimeWarning)  # a random guess may be far from any closed state
                q, u = solver.assemble(q, u, None, inputs, t)
        except (AssemblyError, SingularJointError) as open_loop:
            return f"none of them can be assembled, the last because {open_loop}"
    q, u, inputs = (
        x.astype(solver.parameters.dtype).astype(float) for x in (q, u, inputs)
    )  # rounded to the scalar type, as the solver does
    state = q, u, None, inputs, t
    derivatives = "sensitivities" in solver.operations
    with np.errstate(all="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # states with undefined forces are left out below
        try:
            given = solver.sensitivities(*state, **seeds) if derivatives else (solver.accelerations(*state),)
        except SingularJointError as singular:
            return f"the accelerations have no value, the last because {singular}"
        try:
            of_engine = engine.sensitivities(*state, **seeds) if derivatives else (engine.accelerations(*state),)
        except (ArithmeticError, np.linalg.LinAlgError) as singular:
            return f"the generic engine finds no accelerations, the last because {singular}"
        expected = [np.asarray(x) for x in of_engine]
    if not all(np.isfinite(x).all() for x in expected):
        return ""  # a force such as log(q.a - 1) is undefined there
    # where large terms cancel in a derivative, errors are relative to udot and to derivatives along other directions
    floors = 1e-6, max(1e-6, 1e-3 * max(float(np.max(np.abs(y), initial=0.0)) for y in expected))
    found = {}
    for name, x, y, floor in zip(("udot", "dudot"), given, expected, floors, strict=False):
        pairs = list(zip(np.atleast_2d(x), np.atleast_2d(y), strict=True))
        sizes = [max(float(np.max(np.abs(b), initial=0.0)), floor) for _, b in pairs]
        errors = [float(np.max(np.abs(a - b), initial=0.0)) / n for (a, b), n in zip(pairs, sizes, strict=True)]
        found[name] = math.inf if any(map(math.isnan, errors)) else max(errors)
    return found


__all__ = ["FolderError", "Report", "check_solver", "generate"]
