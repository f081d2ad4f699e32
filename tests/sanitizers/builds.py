"""Compilers and flags for the examination of generated C, and whether this machine has them."""

from __future__ import annotations

import functools
import os
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

ADDRESS = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
QUICK = (*ADDRESS, "-fno-sanitize=null,pointer-overflow,object-size,alignment")
"""Without checks that double the time to compile. What they find, the address sanitizer finds where the pointer is used, and
a load of a misaligned vector stops the program. The campaign has all checks."""
BY_CALLS = ("--param", "asan-instrumentation-with-call-threshold=0")
"""Checks of addresses are calls, which takes gcc less time to compile."""
MEMORY = ("-fsanitize=memory",)
PLAIN = ("-DORDERNM_PLAIN_C", "-std=c99", "-pedantic", "-D_POSIX_C_SOURCE=200112L")
NATIVE = ("-march=native",)
"""The widest vectors that this machine has; without, those that every machine of its kind has."""

ENVIRONMENT = {
    **os.environ,
    "ASAN_OPTIONS": "detect_leaks=0:detect_stack_use_after_return=1",
    "UBSAN_OPTIONS": "print_stacktrace=1",
}


@dataclass(frozen=True)
class Build:
    """A compiler with flags."""

    compiler: str
    flags: tuple[str, ...]

    def __str__(self) -> str:
        return " ".join([self.compiler, *self.flags])

    @property
    def missing(self) -> str:
        """What this machine lacks for the build, and how to install it; empty if the build works."""
        return _missing(self)


@functools.cache  # of a process, which gets a copy of the build with each package
def _missing(build: Build) -> str:
    if not shutil.which(build.compiler):
        return f"{build.compiler} is not installed (Debian: apt-get install {build.compiler})"
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder, "empty.c")
        source.write_text("int main(void) { return 0; }\n")
        command = [build.compiler, *build.flags, str(source), "-o", str(source.with_suffix(""))]
        works = _runs(command) and _runs([str(source.with_suffix(""))])
    sanitizers = "libasan8, libubsan1" if build.compiler == "gcc" else "libclang-rt-dev"
    return "" if works else f"{build} makes no program that runs; its run time may be missing (Debian: {sanitizers})"


def _runs(command: list[str]) -> bool:
    return not subprocess.run(command, capture_output=True, env=ENVIRONMENT, check=False).returncode


GCC, CLANG = Build("gcc", (*QUICK, *BY_CALLS)), Build("clang", QUICK)
GCC_NATIVE, CLANG_NATIVE = Build("gcc", (*GCC.flags, *NATIVE)), Build("clang", (*QUICK, *NATIVE))
GCC_PLAIN, CLANG_PLAIN = Build("gcc", (*GCC.flags, *PLAIN)), Build("clang", (*QUICK, *PLAIN))
CLANG_MEMORY = Build("clang", (*MEMORY, *NATIVE))
EVERY = (
    *(Build(c, ("-O1", *ADDRESS, *more)) for c in ("gcc", "clang") for more in ((), NATIVE, PLAIN)),
    *(Build("clang", (*MEMORY, *more)) for more in ((), NATIVE, PLAIN)),
)
"""With all checks: minutes for one model."""
