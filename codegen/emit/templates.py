"""Renders the templates. They are in ``templates/`` of a checkout, and inside the package in a wheel."""

from __future__ import annotations

import contextlib
import hashlib
import importlib.util
import os
import pickle
import stat
import sys
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import BinaryIO

import jinja2

OPTIONS: dict[str, bool] = {"trim_blocks": True, "lstrip_blocks": True, "keep_trailing_newline": True}
"""Options with which templates are compiled."""


class KeptBeside(jinja2.BytecodeCache):
    """Keeps compiled templates in the folder where Python keeps compiled modules, if Python keeps any.

    A template is compiled again if the template, the options `OPTIONS`, Jinja or Python have changed, or if the folder is not
    writable. Compiling the templates takes a fifth of the time that passes before gcc can start. The kept files contain
    executable code. For safety, a file is read only if it belongs to the owner of the templates or to the user of this
    process, and if no other user can write to it.

    Parameters
    ----------
    folder : Path
        Folder of the templates.
    """

    def __init__(self, folder: Path) -> None:
        self.place = Path(importlib.util.cache_from_source(str(folder / "templates.py")))
        self.owners = {os.geteuid()} if hasattr(os, "geteuid") else {0}
        with contextlib.suppress(OSError):
            self.owners.add(folder.stat().st_uid)

    def _file(self, bucket: jinja2.bccache.Bucket) -> Path:
        options = hashlib.sha256(repr(sorted(OPTIONS.items())).encode()).hexdigest()[:8]
        return self.place.with_name(f"{bucket.key}.{self.place.suffixes[0][1:]}-jinja-{jinja2.__version__}-{options}")

    def _is_ours(self, file: BinaryIO) -> bool:
        found = os.fstat(file.fileno())
        return found.st_uid in self.owners and not found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)

    def load_bytecode(self, bucket: jinja2.bccache.Bucket) -> None:
        """Fills a bucket with stored code, if it was compiled from the same source."""
        damaged = EOFError, ValueError, pickle.UnpicklingError
        with contextlib.suppress(OSError, *damaged), open(self._file(bucket), "rb") as file:
            if self._is_ours(file):
                bucket.load_bytecode(file)

    def dump_bytecode(self, bucket: jinja2.bccache.Bucket) -> None:
        """Write the compiled code of a template to its file."""
        if sys.dont_write_bytecode:
            return
        file = self._file(bucket)
        hidden = file.with_name(f"{file.name}.{os.getpid()}")
        with contextlib.suppress(OSError):
            file.parent.mkdir(mode=0o755, parents=True, exist_ok=True)
            with open(os.open(hidden, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o644), "wb") as made:
                made.write(bucket.bytecode_to_string())
            hidden.replace(file)


@cache
def environment() -> jinja2.Environment:
    package = Path(__file__).resolve().parent.parent
    folders = [package / "templates", package.parent / "templates"]
    return jinja2.Environment(
        loader=jinja2.FileSystemLoader([str(f) for f in folders]),
        undefined=jinja2.StrictUndefined,
        trim_blocks=OPTIONS["trim_blocks"],
        lstrip_blocks=OPTIONS["lstrip_blocks"],
        keep_trailing_newline=OPTIONS["keep_trailing_newline"],
        bytecode_cache=KeptBeside(next((f for f in folders if f.is_dir()), folders[0])),
    )


def render(template: str, context: Mapping[str, object]) -> str:
    """The text of a template with the given variables."""
    return environment().get_template(template).render(context)
