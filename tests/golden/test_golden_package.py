"""A generated package that is stored in the repository, so that reviews show changes of generated code.

``ORDERNM_UPDATE_GOLDEN=1 python -m pytest tests/golden`` writes it anew.
"""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

import codegen
from codegen.version import __version__

HERE = Path(__file__).parent
FUNCTIONS = ("accelerations", "sensitivities", "gradients", "outputs")
FILES = (
    "pendulum.c",
    "pendulum_directions.h",
    "pendulum.h",
    "pendulum_model.h",
    "pendulum_numpy.py",
    "model.json",
    "README.md",
    "__init__.pyi",
)
UPDATE = "ORDERNM_UPDATE_GOLDEN"


@pytest.fixture(scope="module")
def package(tmp_path_factory):
    folder = tmp_path_factory.mktemp("golden") / "pendulum"
    codegen.generate(HERE / "pendulum.yaml", folder, functions=FUNCTIONS, compile=False)
    return folder


def lasting(name, text):
    """A file without the parts that depend on the version and on the run-time files."""
    if name != "model.json":
        return text.replace(f"ordernm {__version__}", "ordernm VERSION")
    manifest = json.loads(text)
    manifest["version"] = "VERSION"
    for changing in ("hash", "digests", "seal", "files"):
        del manifest[changing]
    return json.dumps(manifest, indent=1) + "\n"


@pytest.mark.parametrize("name", FILES)
def test_the_package_is_the_one_that_is_kept(name, package):
    made = lasting(name, (package / name).read_text())
    kept = HERE / "pendulum" / name
    if os.environ.get(UPDATE):
        kept.parent.mkdir(exist_ok=True)
        kept.write_text(made)
    assert made == kept.read_text(), (
        f"{name} has changed; look at the difference, and keep it: {UPDATE}=1 pytest tests/golden"
    )
