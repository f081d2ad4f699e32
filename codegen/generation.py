"""Generate a solver: expand the model, write the package, compile it, check it against the generic engine."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import shutil
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .model import Model, load_model
from .version import __version__

LAYOUTS = ("auto", "kinds", "unrolled")
TARGETS = ("c", "numpy", "both")
CHECK_TOLERANCE = 1e-9
CHECK_LIMIT = 200
"""Models of more bodies are not checked against the generic engine, which is slow."""


class FolderError(ValueError):
    """The output folder holds something that `generate` did not write."""


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
    seconds : dict of str to float
        By stage.
    errors : dict of str to float
        Largest relative errors of the check: of udot, and of its derivative per direction.
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
    warnings: tuple[str, ...]
    seconds: dict[str, float] = field(default_factory=dict)
    compiled: bool = False
    errors: dict[str, float] = field(default_factory=dict)
    remark: str = ""

    def flops(self, *sweeps: str, per: str = "per_call") -> int:
        """Additions, multiplications and divisions of sweeps together."""
        return sum(
            count for s in sweeps if s in self.operations for name, count in self.operations[s][per].items() if name != "functions"
        )


def generate(
    model: Model | str | os.PathLike[str],
    folder: str | os.PathLike[str],
    target: str = "c",
    layout: str = "auto",
    *,
    compile: bool = True,
    check: bool = False,
) -> Report:
    """Write the solver of a model.

    Parameters
    ----------
    model : Model or path
    folder : path
        The package to write. It may hold an earlier output, nothing else.
    target : {"c", "numpy", "both"}
        What the package's `Solver` uses. Both are always written.
    layout : {"auto", "kinds", "unrolled"}
        One C function per kind of link called in loops, or one per link; "auto" takes the second for small models.
    compile, check : bool
        Compile now; compare with `codegen.reference.RecursiveEngine` at three random states.

    Returns
    -------
    Report

    Raises
    ------
    ModelError, FolderError, CompileError
    """
    if target not in TARGETS:
        raise ValueError(f"target is {target!r}; allowed are {', '.join(TARGETS)}")
    if layout not in LAYOUTS:
        raise ValueError(f"layout is {layout!r}; allowed are {', '.join(LAYOUTS)}")
    start = time.perf_counter()
    if not isinstance(model, Model):
        model = load_model(os.fspath(model))
    seconds = {"read": time.perf_counter() - start}
    path = Path(folder).absolute()
    refuse_foreign(path)

    from .emit.solver import write_solver

    source = write_solver(model, layout)
    seconds |= source.seconds
    start = time.perf_counter()
    files = source.files | package_files(source, target)
    write_folder(path, files)
    seconds["write"] = time.perf_counter() - start
    report = Report(
        folder=path, name=model.name, target=target, layout=source.layout, bodies=len(model.bodies),
        links=len(source.system.links), kinds=len(source.system.kinds), nq=model.nq, nu=model.nu,
        parameters=len(model.parameters), files={name: len(text.encode()) for name, text in sorted(files.items())},
        operations=source.manifest["operations"],
        passes=[(n, {"additions": o.additions, "multiplications": o.multiplications, "divisions": o.divisions,
                     "functions": o.functions}, s) for n, o, s in source.passes],
        warnings=model.warnings, seconds=seconds,
    )  # fmt: skip
    if compile and target != "numpy":
        from .runtime.solver import NoCompilerError, compile_library

        start = time.perf_counter()
        try:
            compile_library(path, model.name)
            report.compiled = True
        except NoCompilerError as error:
            report.remark = str(error)
        seconds["compile"] = time.perf_counter() - start
    if check:
        start = time.perf_counter()
        check_solver(model, report)
        seconds["check"] = time.perf_counter() - start
    return report


def package_files(source: Any, target: str) -> dict[str, str]:
    """The files of a package beside the solver's source."""
    from .emit.templates import render

    digest = hashlib.sha256()
    for name, text in sorted(source.files.items()):
        digest.update(f"{name}\0{text}\0".encode())
    manifest = {
        "generator": "ordernm",
        "version": __version__,
        "hash": digest.hexdigest(),
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
    """Raise `FolderError` unless the folder is absent, empty, or an earlier output."""
    if not folder.exists():
        return
    if not folder.is_dir():
        raise FolderError(f"{folder} is a file; give a folder to write into with -o")
    if not any(folder.iterdir()):
        return
    with contextlib.suppress(OSError, ValueError):
        if json.loads((folder / "model.json").read_text(encoding="utf-8")).get("generator") == "ordernm":
            return
    raise FolderError(
        f"{folder} holds something that generate did not write; choose another folder with -o, or empty this one"
    )


def write_folder(folder: Path, files: dict[str, str]) -> None:
    """Write a package as a whole: it is complete beside its place before it takes it."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
    try:
        for name, text in files.items():
            (temporary / name).write_text(text, encoding="utf-8", newline="\n")
        temporary.chmod(0o755)
        old = None
        if folder.exists():
            _keep_libraries(folder, temporary)
            old = Path(tempfile.mkdtemp(prefix=f".{folder.name}-old-", dir=folder.parent))
            os.replace(folder, old / folder.name)
        os.replace(temporary, folder)
        if old is not None:
            shutil.rmtree(old, ignore_errors=True)
    except BaseException:
        shutil.rmtree(temporary, ignore_errors=True)
        raise


def _keep_libraries(old: Path, new: Path) -> None:
    """Take compiled libraries along where the C has not changed."""
    for source in new.glob("*.[ch]"):
        before = old / source.name
        if not before.is_file() or before.read_bytes() != source.read_bytes():
            return
    for library in old.glob("*.so"):
        shutil.copy2(library, new / library.name)


def check_solver(model: Model, report: Report) -> None:
    """Compare the written solver with the generic engine at three random states; fills `Report.errors`."""
    if len(model.bodies) > CHECK_LIMIT:
        report.remark = f"not checked: more than {CHECK_LIMIT} bodies"
        return
    import numpy as np

    from .reference import RecursiveEngine
    from .runtime import load

    solver = load(report.folder)
    engine = RecursiveEngine(model)
    rng = np.random.default_rng(1)
    q0, u0 = solver.initial
    errors = {"udot": 0.0, "dudot": 0.0}
    for _ in range(3):
        q = q0 + 0.5 * rng.normal(size=solver.nq)
        u = u0 + rng.normal(size=solver.nu)
        inputs = rng.normal(size=solver.ninputs)
        p = solver.parameters
        seeds = {
            "dq": rng.normal(size=(3, solver.nq)), "du": rng.normal(size=(3, solver.nu)),
            "dp": rng.normal(size=(3, solver.np)), "dinputs": rng.normal(size=(3, solver.ninputs)),
        }  # fmt: skip
        udot, dudot = solver.sensitivities(q, u, p, inputs, 0.3, **seeds)
        ref, dref = engine.sensitivities(q, u, p, inputs, 0.3, **seeds)
        for name, x, y in (("udot", udot[None], np.asarray(ref)[None]), ("dudot", dudot, np.asarray(dref))):
            for a, b in zip(x, y, strict=True):
                scale = max(float(np.max(np.abs(b), initial=0.0)), 1e-6)
                errors[name] = max(errors[name], float(np.max(np.abs(a - b), initial=0.0)) / scale)
    report.errors = errors
