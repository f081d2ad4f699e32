"""The loops that measure the peak performance of a core."""

import platform
import re
import subprocess

import pytest

from codegen.measure.core import CORE_C, IN_CACHE, IN_MEMORY, LENGTH
from codegen.runtime.standalone.files.compiler import STANDARD, find_compiler, optimization

VECTORS = {"x86_64": r"\bv?(addpd|fn?madd\d+pd)\b", "aarch64": r"\b(fmla|fadd)\s+v"}


def test_arrays_are_summed_in_vectors(tmp_path):
    """By flags with which gcc makes none of a plain loop: the roofs of the cache and of memory were those of single numbers."""
    if platform.machine() not in VECTORS:
        pytest.skip(f"what vectors are called on {platform.machine()} is not known here")
    (tmp_path / "core.c").write_text(CORE_C)
    flags = [f for f in STANDARD if f != "-shared"]
    subprocess.run([*find_compiler(), *flags, *optimization(), "-S", "core.c"], cwd=tmp_path, check=True)
    (body,) = re.findall(
        r"^bytes:\n(.*?)^\s*\.size\s+bytes", (tmp_path / "core.s").read_text(), re.DOTALL | re.MULTILINE
    )
    assert len(re.findall(VECTORS[platform.machine()], body)) >= 4
    assert not any(n % 32 for n in (IN_CACHE, IN_MEMORY, LENGTH)), "no rest of single numbers"
