"""``ordernm import``: what it may be asked for, and what it says."""

from __future__ import annotations

import argparse
import os
from dataclasses import fields
from pathlib import Path

from .bodies import BASES
from .importer import Imported, Options, import_model
from .parameters import WORDS


class ExistsError(Exception):
    """Something else stands where the model is to be written."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of ``ordernm import``."""
    parser.add_argument("file", help="robot: URDF, MJCF or SDF")
    parser.add_argument(
        "-o", "--output", metavar="FILE", help="model file to write (default: ./NAME.yaml); - prints it"
    )
    parser.add_argument("--force", action="store_true", help="replace a model file that differs")
    parser.add_argument("--name", help="name of the model (default: the robot's)")
    parser.add_argument(
        "--model", metavar="NAME",
        help="which model of a world of SDF, robot or robot::arm (default: the only one that moves)",
    )  # fmt: skip
    parser.add_argument("--key", metavar="NAME", help="keyframe of an MJCF to begin in (default: the first; '': none)")
    parser.add_argument(
        "--base", choices=BASES, help="how the root of a URDF is attached to the ground (default: fixed)"
    )
    parser.add_argument("--keep-fixed", action="store_true", help="keep links on fixed joints as bodies of their own")
    parser.add_argument(
        "--loops", metavar="FILE", help="YAML with a section loops in the model format, or Gepetto's robot.yaml"
    )
    parser.add_argument("--motors", action="store_true", help="an input for the force along every freedom of a joint")
    parser.add_argument(
        "--exact-angles", action="store_true", help="1.5708 means pi/2: axes are parallel to all digits"
    )
    parser.add_argument(
        "--parameterize", metavar="LINK:WORD,...",
        help=f"make parameters of numbers: link, colon, word, and commas between such pairs; WORD is {', '.join(WORDS)}",
    )  # fmt: skip
    parser.add_argument(
        "--repair", action="store_true", help="mend inertias that no body has, and fix joints that move nothing"
    )
    parser.add_argument("--free-mimic", action="store_true", help="leave joints that mimic others independent")
    parser.add_argument(
        "--package-path", action="append", default=[], metavar="DIR",
        help="where packages are that package:// and model:// name; may be given more than once. Other files than the "
        "robot's are read in its folder and in these only",
    )  # fmt: skip


def run(options: argparse.Namespace) -> tuple[Imported, Path | None]:
    """Read the robot and write the model; also where, or None if it is to be printed.

    Raises
    ------
    ModelError
    ExistsError
    """
    chosen = {f.name: getattr(options, f.name) for f in fields(Options) if f.name != "package_paths"}
    if options.output == "-" and options.force:
        raise ExistsError("--force is for a file that -o replaces, and -o - prints; leave it out")
    found = import_model(options.file, package_paths=options.package_path, **chosen)
    if options.output == "-":
        return found, None
    target = Path(options.output if options.output is not None else f"{found.model.name}.yaml")
    if os.path.lexists(target) and not options.force:
        if target.is_file() and target.read_bytes() == found.text.encode("utf-8"):
            return found, target
        raise ExistsError(f"{target} exists and is something else; choose another file with -o, or --force")
    return found, found.save(target)
