"""Renders the templates. They live in ``templates/`` of the checkout, inside the package in a wheel."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import pickle
import sys
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import jinja2


class KeptBeside(jinja2.BytecodeCache):
    """Keeps compiled templates where Python would keep what modules in their folder are compiled to, if it keeps that.

    A template is compiled anew when it has changed, or Jinja or Python have. To compile them takes a fifth of the time for which
    gcc waits; where nothing can be written it is done each time.

    Parameters
    ----------
    folder : Path
        That of the templates.
    """

    def __init__(self, folder: Path) -> None:
        self.place = Path(importlib.util.cache_from_source(str(folder / "templates.py")))

    def _file(self, bucket: jinja2.bccache.Bucket) -> Path:
        return self.place.with_name(f"{bucket.key}.{self.place.suffixes[0][1:]}-jinja-{jinja2.__version__}")

    def load_bytecode(self, bucket: jinja2.bccache.Bucket) -> None:
        """Fill a bucket with what is kept, if that is of the same source."""
        damaged = EOFError, ValueError, pickle.UnpicklingError
        with contextlib.suppress(OSError, *damaged), open(self._file(bucket), "rb") as file:
            bucket.load_bytecode(file)

    def dump_bytecode(self, bucket: jinja2.bccache.Bucket) -> None:
        """Keep what a bucket holds."""
        if sys.dont_write_bytecode:
            return
        file = self._file(bucket)
        hidden = file.with_name(f"{file.name}.{os.getpid()}")
        with contextlib.suppress(OSError):
            file.parent.mkdir(parents=True, exist_ok=True)
            hidden.write_bytes(bucket.bytecode_to_string())
            hidden.replace(file)


@cache
def environment() -> jinja2.Environment:
    package = Path(__file__).resolve().parent.parent
    folders = [package / "templates", package.parent / "templates"]
    return jinja2.Environment(
        loader=jinja2.FileSystemLoader([str(f) for f in folders]),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        bytecode_cache=KeptBeside(next((f for f in folders if f.is_dir()), folders[0])),
    )


def render(template: str, context: Mapping[str, object]) -> str:
    """The text of a template."""
    return environment().get_template(template).render(context)
