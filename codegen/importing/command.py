"""``ordernm import``: arguments and messages of the command."""

from __future__ import annotations

import argparse
import os
from dataclasses import fields
from pathlib import Path

from .bodies import BASES
from .importer import Imported, import_model
from .options import Options
from .parameters import WORDS


class ExistsError(Exception):
    """Raised if another file exists where the model is to be written."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``ordernm import``."""
    parser.add_argument("file", help="robot: URDF, MJCF or SDF")
    parser.add_argument(
        "-o", "--output", metavar="FILE", help="model file to write (default: ./NAME.yaml); - prints it"
    )
    parser.add_argument("--force", action="store_true", help="replace a model file that differs")
    parser.add_argument("--name", help="name of the model (default: the robot's)")
    parser.add_argument(
        "--model", metavar="NAME",
        help="model of an SDF world to read, robot or robot::arm (default: the only one that moves)",
    )  # fmt: skip
    parser.add_argument("--key", metavar="NAME", help="initial keyframe of an MJCF (default: the first; '': none)")
    parser.add_argument(
        "--base", choices=BASES, help="how the root of a URDF is attached to the ground (default: fixed)"
    )
    parser.add_argument("--keep-fixed", action="store_true", help="keep links on fixed joints as bodies of their own")
    parser.add_argument(
        "--loops", metavar="FILE", help="YAML with a section loops in the model format, or Gepetto's robot.yaml"
    )
    parser.add_argument("--motors", action="store_true", help="an input for the force along every degree of freedom")
    parser.add_argument(
        "--exact-angles", action="store_true", help="take 1.5708 as pi/2, so that axes are exactly parallel"
    )
    parser.add_argument(
        "--parameterize", metavar="LINK:WORD,...",
        help=f"make parameters of numbers: comma-separated pairs LINK:WORD; WORD is {', '.join(WORDS)}",
    )  # fmt: skip
    parser.add_argument(
        "--repair", action="store_true", help="replace impossible inertias, and fix joints that move nothing"
    )
    parser.add_argument("--free-mimic", action="store_true", help="leave joints that mimic others independent")
    parser.add_argument(
        "--package-path", action="append", default=[], metavar="DIR",
        help="folder of packages for package:// and model:// names; may be repeated. Other files are read only from the "
        "robot's folder and from these",
    )  # fmt: skip


def run(options: argparse.Namespace) -> tuple[Imported, Path | None]:
    """Read the robot and make the model. Returns the import, and the model file or None if it is printed.

    Raises
    ------
    ModelError
    ExistsError
    """
    chosen = {f.name: getattr(options, f.name) for f in fields(Options) if f.name not in ("package_paths", "folder")}
    if options.output == "-" and options.force:
        raise ExistsError("--force replaces a file, and -o - prints the model; remove --force")
    folder = Path(options.output or "").parent if options.output != "-" else Path()
    found = import_model(options.file, package_paths=options.package_path, folder=folder, **chosen)
    if options.output == "-":
        return found, None
    target = Path(options.output if options.output is not None else f"{found.model.name}.yaml")
    if os.path.lexists(target) and not options.force:
        if target.is_file() and target.read_bytes() == found.text.encode("utf-8"):
            return found, target
        raise ExistsError(f"{target} exists and differs; choose another file with -o, or use --force")
    return found, found.save(target)
