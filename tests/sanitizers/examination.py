"""Generates a package, compiles it with sanitizers and calls every function of its headers."""

from __future__ import annotations

import subprocess
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from sanitizers.builds import ENVIRONMENT, Build
from sanitizers.calls import Part, parts

import codegen
from codegen.model import parse_model

HARNESS = Path(__file__).parent / "harness.c"
EXAMPLES = Path(__file__).parents[2] / "examples"
"""What models include is there."""
WARNINGS = ("-Wall", "-Wextra", "-Werror")


@dataclass(frozen=True)
class Package:
    """The text of a model, the options of its generation, and the builds that examine its functions."""

    name: str
    text: str
    options: tuple[tuple[str, Any], ...]
    builds: tuple[Build, ...]
    warned: tuple[Build, ...] = ()
    """Builds that are only compiled, with all warnings being errors."""
    thorough: bool = False
    """Whether a second partition, which has the same templates, is built in more than the last way."""
    second: bool = True
    """Whether a second partition is examined, if there is one."""
    singular: tuple[dict[str, float], ...] = ()
    """States to call everything in as well; see `Part.calls`."""

    @property
    def missing(self) -> str:
        """What this machine lacks for every build; empty if one build works."""
        missing = [b.missing for b in (*self.builds, *self.warned)]
        return "; ".join(dict.fromkeys(missing)) if all(missing) else ""


def examine(package: Package, folder: Path) -> list[str]:
    """The errors found in a package; empty if there are none."""
    codegen.generate(parse_model(package.text, package.name, EXAMPLES), folder, compile=False, **dict(package.options))
    complaints = []
    for i, part in enumerate(parts(folder)[: 1 + package.second]):
        for build in filter(works, package.warned if not i else ()):
            complaints += warnings_of(part, build)
        calls = part.calls(np.random.default_rng(zlib.crc32(part.name.encode())), package.singular)
        (folder / "calls.h").write_text(part.header())
        part.write(calls, folder / "in")
        for build in filter(works, package.builds if not i or package.thorough else package.builds[-1:]):
            complaint = run(part, build)
            if not complaint:
                try:
                    part.check(calls, folder / "out")
                except AssertionError as error:
                    complaint = f"wrong: {error}"
            complaints += [f"{part.name}, {build}: {complaint}"] if complaint else []
    return complaints


def works(build: Build) -> bool:
    return not build.missing


def warnings_of(part: Part, build: Build) -> list[str]:
    found = []
    apart = {f"{part.name}_{what}.c" for what in ("states", "threads")}
    for source in sorted(({f"{part.name}.c"} | apart) & {file.name for file in part.folder.iterdir()}):
        command = [build.compiler, *build.flags, *WARNINGS, "-c", source, "-o", "warned.o"]
        said = subprocess.run(command, cwd=part.folder, capture_output=True, text=True, check=False)
        found += [f"{source}, {build}: {said.stderr[:1000]}"] if said.returncode else []
    return found


def run(part: Part, build: Build) -> str:
    """Compile and run the harness; returns the error output if that failed."""
    states = f"{part.name}_states.c"
    sources = [f"{part.name}.c", *([states] if (part.folder / states).is_file() else []), str(HARNESS)]
    command = [build.compiler, *build.flags, "-g1", *WARNINGS, "-I.", *sources, "-o", "examined", "-lm"]
    for step in (command, ["./examined", "in", "out"]):
        said = subprocess.run(
            step, cwd=part.folder, capture_output=True, text=True, errors="replace", env=ENVIRONMENT, check=False
        )
        if said.returncode:
            return f"exit code {said.returncode}: {said.stderr[:1500]}"
    return ""
