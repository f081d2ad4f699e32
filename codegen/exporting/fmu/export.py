"""``ordernm export MODEL --fmu``: a functional mock-up unit of FMI 3.0 or 2.0, for Model Exchange and Co-Simulation."""

from __future__ import annotations

import contextlib
import hashlib
import os
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Real
from pathlib import Path
from typing import Any

from ...folders import FolderError
from ...generation import check_flags
from ...model.loading import load_model
from ...model.model import Model
from ...model.outputs import Output
from ...pipeline import write_solver
from ...program.progress import Progress, silent
from ...runtime.standalone.motion.settings import METHODS, RTOL
from .binaries import chosen, compiled
from .description import TOOL, Contents, build_description, description_2, description_3
from .source import sources, with_token
from .variables import Dependencies, variables

VERSIONS = ("3.0", "2.0")

ENERGIES = {"energy.kinetic": "kinetic_energy", "energy.potential": "potential_energy"}
"""Names and measures of outputs that a model need not declare."""

EPOCH = (1980, 1, 1, 0, 0, 0)
"""Date of all files in an FMU: equal models give equal bytes."""


@dataclass(frozen=True, slots=True)
class ExportedFMU:
    """A functional mock-up unit.

    Attributes
    ----------
    file : Path
    fmi : str
        Version of the standard.
    platforms : tuple of str
        Platforms with a binary.
    states : tuple of str
        Names of the continuous states of Model Exchange.
    variables : tuple of str
        Names of all variables; the place of each is its value reference.
    indicators : int
        Number of event indicators.

    Examples
    --------
    >>> import ordernm, tempfile
    >>> found = ordernm.export_fmu("examples/pendulum.yaml", tempfile.mkdtemp() + "/pendulum.fmu", platforms="none")
    >>> found.states
    ('q.bar', 'u.bar')
    """

    file: Path
    fmi: str
    platforms: tuple[str, ...]
    states: tuple[str, ...]
    variables: tuple[str, ...]
    indicators: int

    def __repr__(self) -> str:
        return (
            f"{self.file}: FMI {self.fmi}, {len(self.states)} states, {len(self.variables)} variables, "
            f"{self.indicators} event indicators; binaries: {', '.join(self.platforms) or 'none, source code only'}"
        )


def export_fmu(
    model: Model | str | os.PathLike[str],
    file: str | os.PathLike[str] | None = None,
    *,
    fmi: str = "3.0",
    platforms: Sequence[str] | str | None = None,
    method: str = "dop853",
    energies: bool = False,
    stop: float = 1.0,
    force: bool = False,
    progress: Progress = silent,
) -> ExportedFMU:
    """Write a functional mock-up unit for Model Exchange and Co-Simulation, with its source code.

    Parameters
    ----------
    model : Model or path
        The model, or its file.
    file : path, optional
        The file to write. Default: ``exported/NAME.fmu``.
    fmi : {"3.0", "2.0"}, optional
        Version of the standard.
    platforms : sequence of str, or str with commas, optional
        Platforms to compile for: ``x86_64-linux``, ``aarch64-linux``, ``x86_64-windows``, ``x86_64-darwin``,
        ``aarch64-darwin``; ``"all"`` of them, or ``"none"``, for source code only. Default: this machine.
    method : {"dop853", "radau", "rk4"}, optional
        Integrator of Co-Simulation, as in `Solver.simulate`; "radau" serves stiff models, and "rk4" is not available.
    energies : bool, optional
        Add the outputs ``energy.kinetic`` and ``energy.potential``, J.
    stop : float, optional
        End of the default experiment, s.
    force : bool, optional
        Also replace a file that ordernm did not write.
    progress : callable, optional
        Called as ``progress(stage, step, steps)``.

    Returns
    -------
    ExportedFMU
        The file, its states and variables.

    Raises
    ------
    ModelError
        If the model has no solver, or two variables would have the same name.
    FolderError
        If the file cannot be written.
    NoCompilerError, CompileError
        If a platform has no compiler, or its compiler fails.
    ValueError
        If a version, platform or method is unknown.

    Examples
    --------
    >>> import ordernm, tempfile
    >>> found = ordernm.export_fmu("examples/four_bar.yaml", tempfile.mkdtemp() + "/four_bar.fmu", platforms="none")
    >>> found.states, found.indicators
    (('q.crank', 'u.crank'), 0)
    """
    # long: the docstring describes every argument
    if fmi not in VERSIONS:
        raise ValueError(f"fmi={fmi!r}, expected one of {', '.join(VERSIONS)}")
    if method not in METHODS or method == "rk4":
        raise ValueError(f"method={method!r}, expected dop853 or radau, which choose their steps")
    if not isinstance(stop, Real) or not 0.0 < stop < float("inf"):
        raise ValueError(f"stop={stop!r}, expected a positive number of seconds")
    wanted = chosen(platforms, fmi)
    check_flags(energies=energies, force=force)
    model = model if isinstance(model, Model) else load_model(model)
    model = _with_energies(model) if energies else model
    path = Path("exported", f"{model.name}.fmu") if file is None else Path(file)
    _refuse_file(path, force)
    source = write_solver(model, functions=["motion"], progress=progress)
    manifest = source.manifest
    manifest["initial"] = _initial(model, manifest)
    found = variables(model, manifest)
    texts = sources(
        model, manifest, source.files, found, version=fmi, method=method, rtol=RTOL, initial=manifest["initial"]
    )
    contents = Contents(
        model.name, f"multibody system {model.name}", found,
        Dependencies(model, manifest, found), sorted(f for f in texts if f.endswith(".c")), float(stop), RTOL,
    )  # fmt: skip
    files = _described(contents, texts, fmi)
    progress("compiling", 0, 0)
    texts = {name.removeprefix("sources/"): text for name, text in files.items() if name.endswith((".c", ".h"))}
    binaries = compiled(texts, model.name, wanted, fmi)
    _write(path, {name: text.encode() for name, text in files.items()} | binaries)
    states = tuple(found[x.state].name for x in found if x.state is not None)
    return ExportedFMU(
        path, fmi, tuple(wanted), states, tuple(x.name for x in found), sum(x.kind == "switch" for x in found)
    )


def _with_energies(model: Model) -> Model:
    """The model with both energies as outputs."""
    known = {o.name for o in model.outputs}
    return replace(
        model, outputs=(*model.outputs, *(Output(n, measure) for n, measure in ENERGIES.items() if n not in known))
    )


def _initial(model: Model, manifest: Mapping[str, Any]) -> dict[str, list[float]]:
    """The initial state at the default parameters; an equilibrium is computed by a solver."""
    if not model.initial_at_rest:
        return {kind: [float(x) for x in manifest["initial"][kind]] for kind in ("q", "u")}
    from ...generation import generate
    from ...runtime import load

    with tempfile.TemporaryDirectory(prefix="ordernm-") as folder:
        generate(model, folder, target="numpy", compile=False, check=False)
        q, u = load(folder).initial
    return {"q": q.tolist(), "u": u.tolist()}


def _described(contents: Contents, texts: Mapping[str, str], version: str) -> dict[str, str]:
    """All text files of an FMU, by their paths."""
    write = description_3 if version == "3.0" else description_2
    digest = hashlib.sha256(write(contents).encode())
    for name in sorted(texts):
        digest.update(f"\0{name}\0{texts[name]}".encode())
    x = digest.hexdigest()
    contents.token = f"{{{x[:8]}-{x[8:12]}-{x[12:16]}-{x[16:20]}-{x[20:32]}}}"
    files = {f"sources/{name}": text for name, text in with_token(texts, contents.name, contents.token).items()}
    if version == "3.0":
        files["sources/buildDescription.xml"] = build_description(contents, ())
    return {"modelDescription.xml": write(contents)} | files


def _refuse_file(path: Path, force: bool) -> None:
    """Raises `FolderError` if the file exists and ordernm did not write it."""
    if path.is_dir():
        raise FolderError(f"{path} is a folder; give the name of a file with -o")
    if not path.exists() or force:
        return
    with contextlib.suppress(OSError, zipfile.BadZipFile, KeyError), zipfile.ZipFile(path) as archive:
        if f'generationTool="{TOOL.split()[0]} ' in archive.read("modelDescription.xml").decode("utf-8", "replace"):
            return
    raise FolderError(
        f"{path} is a file that ordernm did not write; choose another name with -o, or use --force to replace it"
    )


def _write(path: Path, files: Mapping[str, bytes]) -> None:
    """Writes the archive to a temporary file in the same folder, and renames this file to `path` when it is
    complete."""
    beside = path.with_name(f".{path.name}-{os.getpid()}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with zipfile.ZipFile(beside, "w", zipfile.ZIP_DEFLATED) as archive:
                for name in sorted(files, key=lambda n: (n != "modelDescription.xml", n)):
                    entry = zipfile.ZipInfo(name, EPOCH)
                    entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o644 << 16
                    archive.writestr(entry, files[name])
            os.replace(beside, path)
        finally:
            beside.unlink(missing_ok=True)
    except OSError as error:
        raise FolderError(f"cannot write {path}: {error.strerror or error}") from None
