"""Exported FMUs, and solvers of the same models, for `tests/exporting/fmu`."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Model, FMU2Slave
from fmpy.fmi3 import FMU3Model, FMU3Slave, fmi3LogMessageCallback

import codegen

HERE = Path(__file__).parent / "exporting" / "fmu"
EXAMPLES = HERE.parents[2] / "examples"


def model_file(name: str, folder: Path = HERE) -> Path:
    """The file of a model in `tests/exporting/fmu`, or of an example."""
    found = (place / f"{name}.yaml" for place in (folder, HERE, EXAMPLES))
    return next(file for file in found if file.exists())


class Unit:
    """An exported FMU, unpacked.

    Parameters
    ----------
    name : str
        Model of the folder, of `tests/exporting/fmu`, or example.
    folder : Path
    version : {"3.0", "2.0"}
    """

    def __init__(self, name: str, folder: Path, version: str, **options: Any) -> None:
        self.file = folder / f"{name}_{version}.fmu"
        self.exported = codegen.export_fmu(model_file(name, folder), self.file, fmi=version, **options)
        self.folder = extract(str(self.file), str(folder / f"{name}_{version}"))
        self.description = read_model_description(str(self.file))
        self.version = version
        self.numbers = {n: i for i, n in enumerate(self.exported.variables)}
        self.messages: list[tuple[int, str]] = []

    def instance(self, integrates: bool = False) -> Any:
        """A new instance before its initialisation; its messages are recorded."""
        classes = {
            ("3.0", False): FMU3Model,
            ("3.0", True): FMU3Slave,
            ("2.0", False): FMU2Model,
            ("2.0", True): FMU2Slave,
        }
        of = classes[self.version, integrates](
            guid=self.description.guid, unzipDirectory=self.folder, instanceName="unit",
            modelIdentifier=self.description.modelExchange.modelIdentifier,
        )  # fmt: skip
        if self.version == "3.0":
            log = fmi3LogMessageCallback(
                lambda environment, status, category, text: self.messages.append((status, text.decode()))
            )
            of.instantiate(loggingOn=False, logMessage=log)
            of.kept = log
        else:
            of.instantiate()
        return of

    def initializing(self, integrates: bool = False, t: float = 0.0, times: Any = None, **values: float) -> Any:
        """An instance in initialization mode; `times` may have a `tolerance` and a `stopTime`."""
        of = self.instance(integrates)
        self.set(of, values)
        if self.version == "2.0":
            of.setupExperiment(startTime=t, **times or {})
            of.enterInitializationMode()
        else:
            of.enterInitializationMode(startTime=t, **times or {})
        return of

    def started(self, integrates: bool = False, t: float = 0.0, times: Any = None, **values: float) -> Any:
        """An instance after initialisation, with values of parameters, inputs and initial states."""
        of = self.initializing(integrates, t, times, **values)
        of.exitInitializationMode()
        return of

    def set(self, of: Any, values: dict[str, float]) -> None:
        numbers = [self.numbers[n] for n in values]
        (of.setFloat64 if self.version == "3.0" else of.setReal)(numbers, list(values.values()))

    def get(self, of: Any, names: list[str]) -> np.ndarray:
        numbers = [self.numbers[n] for n in names]
        return np.array((of.getFloat64 if self.version == "3.0" else of.getReal)(numbers))

    def along(self, of: Any, unknowns: list[str], knowns: list[str], seed: list[float]) -> np.ndarray:
        numbers = [self.numbers[n] for n in unknowns], [self.numbers[n] for n in knowns]
        return np.array(of.getDirectionalDerivative(*numbers, seed))

    def adjoint(self, of: Any, unknowns: list[str], knowns: list[str], seed: list[float]) -> np.ndarray:
        numbers = [self.numbers[n] for n in unknowns], [self.numbers[n] for n in knowns]
        return np.array(of.getAdjointDerivative(*numbers, seed, len(knowns)))


def solver_of(name: str, folder: Path, functions: str) -> Any:
    """A solver of the same model."""
    path = folder / f"{name}_solver"
    shutil.rmtree(path, ignore_errors=True)
    codegen.generate(model_file(name, folder), path, functions=functions, check=False)
    return codegen.load(path)
