"""``import ordernm``: the package `codegen` under the name of the project, with the same module objects.

``ordernm.reference is codegen.reference``: nothing is loaded twice; classes, errors and pickles are the same under both names.
In a wheel, this folder is beside `codegen`; an editable install uses the folder of the source tree.
"""

from __future__ import annotations

import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import sys
from collections.abc import Sequence
from types import CodeType, ModuleType

import codegen

ALIAS, NAME = __name__, codegen.__name__


def _named(alias: str) -> str:
    """The module of ``codegen`` that has the given name within the alias ``ordernm``."""
    return NAME + alias.removeprefix(ALIAS)


class _Finder(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Finder of ``ordernm.X``: imports ``codegen.X`` and returns that module."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if not fullname.startswith(f"{ALIAS}."):
            return None
        found = importlib.util.find_spec(_named(fullname))
        if found is None:
            return None
        spec = importlib.machinery.ModuleSpec(fullname, self, origin=found.origin, loader_state=found)
        spec.submodule_search_locations = found.submodule_search_locations
        return spec

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> ModuleType:
        module = importlib.import_module(_named(spec.name))
        spec.loader_state = module.__spec__  # `spec` is about to take its place
        return module

    def exec_module(self, module: ModuleType) -> None:
        if module.__spec__ is not None and module.__spec__.loader is self:
            module.__spec__ = module.__spec__.loader_state

    def get_code(self, fullname: str) -> CodeType | None:
        """The code of the package's main module, for ``python -m ordernm``."""
        found = importlib.util.find_spec(_named(fullname))
        loader = None if found is None else found.loader
        return loader.get_code(_named(fullname)) if isinstance(loader, importlib.abc.InspectLoader) else None


sys.meta_path.insert(0, _Finder())
sys.modules[ALIAS] = codegen
