"""NumPy modules of a package with constants in more digits, generated from its model for `Solver.in_precision`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .standalone.trust.precision import GUARD

if TYPE_CHECKING:
    from ..model import Model


class ExtendedModules:
    """Returns the NumPy module of each partition, with constants computed from the model in more digits.

    Parameters
    ----------
    model : Model or path
        The model from which the package was generated.
    manifest : dict
        The manifest of the package.
    digits : int

    Raises
    ------
    ValueError
        If the package was generated from another model.
    ModelError
    """

    def __init__(self, model: Any, manifest: Mapping[str, Any], digits: int):
        self.manifest, self.digits = manifest, digits
        self.model = _read(model, manifest)
        if _named(self.model) != _expected(manifest):
            raise ValueError(
                f"model: {self.model.name} is not the model that the package {manifest['name']} was generated from"
            )

    def __call__(self, partition: int) -> str:
        # imported here, so that loading a solver does not import the generator
        from ..loops.alternatives import other_partition
        from ..loops.partition import partition as choose
        from ..pipeline import write_long

        chosen = choose(self.model) if self.model.loops else None
        known: list[Any] = []
        for _ in range(partition if chosen is not None else 0):
            known.append(chosen)
            chosen = other_partition(self.model, known)
        made = self.manifest["functions"]
        asked = [f.get("member", name) for name, f in made.items()] if "left_out" in self.manifest else None
        more = "reactions" in made, asked, asked is None and "frames" in made
        return write_long(self.model, self.digits + GUARD, self.manifest["layout"], chosen, *more)


def _read(model: Any, manifest: Mapping[str, Any]) -> Model:
    from ..model import Model, load_model

    if isinstance(model, Model):
        return model
    known = (manifest.get("origin") or {}).get("sha256")
    read, file = load_model(model), Path(model)
    if known and file.is_file() and read.digest != known:
        raise ValueError(
            f"model: {file} is not the model file of the package, or has changed since; generate the package again"
        )
    return read


def _named(model: Model) -> dict[str, Any]:
    """The properties by which a model and its package are compared."""
    return {
        "name": model.name, "coordinate_names": [*model.coordinate_names], "speed_names": [*model.speed_names],
        "parameter_names": [*model.parameter_names], "parameters": [*model.defaults.values()],
        "input_names": [*model.inputs], "output_names": [o.name for o in model.outputs],
        "loops": [loop.name for loop in model.loops],
    }  # fmt: skip


def _expected(manifest: Mapping[str, Any]) -> dict[str, Any]:
    """The properties that a model must share with a package, from the manifest of the package."""
    names = ("coordinate_names", "speed_names", "parameter_names", "parameters", "input_names", "output_names")
    return {"name": manifest["name"], **{n: [*manifest[n]] for n in names}, "loops": [*manifest.get("loops", ())]}


__all__ = ["ExtendedModules"]
