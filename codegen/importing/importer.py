"""Converts a robot file, or an object of another program, into a model."""

from __future__ import annotations

import contextlib
import errno
import os
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from pathlib import Path
from typing import Any, Final

import numpy as np

from ..html_tables import html_of
from ..model import Model, ModelError, parse_model
from ..model.errors import Problem
from ..model.file_bytes import file_name
from ..model.positions import shortened
from .bodies import BASES, Bodies, merged_bodies, put_on_ground
from .files import Files
from .gepetto import apply_gepetto, beside, is_gepettos
from .mass import FIXED, check_finite, check_inertias, fix_massless
from .naming import free_name, model_name, names_a_model, names_for
from .options import Options, options_of
from .parameters import Parameters, requested_words
from .placement import Three, exact_sum
from .robot import SINGLE, WORLD, BodyForce, Coupling, Effect, Mark, Robot
from .side_file import SideFile, read_side_file
from .words import number, one_line, vector, wrapped
from .writing import ModelWriter
from .xml_reading import Element, no_regular_file, parse_xml, read_robot_file

FORMATS: Final = {"robot": "URDF", "mujoco": "MJCF", "sdf": "SDF"}
"""Formats of robot files, by name of the root element."""


@dataclass(frozen=True, slots=True)
class Imported:
    """An imported robot: the model, its text, and the differences from the file.

    Attributes
    ----------
    text : str
        The model file.
    model : Model
        The model.
    left_out : tuple of str
        Parts of the file that the model lacks, with their lines and the effect on the motion.
    differences : tuple of str
        Those parts of `left_out` that change the motion even though nothing drives the robot.
    warnings : tuple of str
        Doubtful entries, and entries that were repaired.
    bodies : dict of str to str
        Body of the model (or ``ground``) that each link of the file is part of.
    frames : dict of str to (str, tuple of float, tuple of float)
        For each link that is not a body of its own: its body or ``ground``, its position there (m), and roll, pitch and
        yaw (rad).
    joints : dict of str to str
        Body that each moving joint of the file carries. Its coordinates have the body's name.
    renamed : dict of str to str
        New names by the names of the file.
    symbols : dict of sympy.Basic to str
        Names in the model by sympy symbols and functions; empty unless the model comes from sympy.
    """

    text: str
    model: Model
    left_out: tuple[str, ...] = ()
    differences: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    bodies: dict[str, str] = field(default_factory=dict)
    frames: dict[str, tuple[str, Three, Three]] = field(default_factory=dict)
    joints: dict[str, str] = field(default_factory=dict)
    renamed: dict[str, str] = field(default_factory=dict)
    symbols: dict[Any, str] = field(default_factory=dict)

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the model file; if that fails, an existing file is unchanged.

        Parameters
        ----------
        path : path
            The file. An existing file is replaced.

        Returns
        -------
        Path
            The file that was written.

        Examples
        --------
        >>> found = ordernm.import_model("robot.urdf")  # doctest: +SKIP
        >>> found.save("robot.yaml")  # doctest: +SKIP
        """
        target = Path(path)
        if not target.parent.is_dir():
            raise FileNotFoundError(errno.ENOENT, "no such folder; make it first", str(target.parent))
        handle, temporary = tempfile.mkstemp(prefix=f".{target.name}-", dir=target.parent)
        try:
            with open(handle, "w", encoding="utf-8") as file:
                file.write(self.text)
            mask = os.umask(0)
            os.umask(mask)
            os.chmod(temporary, 0o666 & ~mask)
            os.replace(temporary, target)
        except BaseException:
            with contextlib.suppress(OSError):
                os.unlink(temporary)
            raise
        return target

    def __repr__(self) -> str:
        return f"<Imported {self.model.name}: {len(self.model.bodies)} bodies, {self.model.nu} speeds>"

    def _repr_html_(self) -> str:
        return html_of(
            [repr(self)], ("", ""), [("left out", x) for x in self.left_out] + [("warning", x) for x in self.warnings]
        )


def import_model(path: str | os.PathLike[str], **options: Any) -> Imported:
    """Read a robot file in URDF, MJCF or SDF.

    Parameters
    ----------
    path : str or path
        The robot file.
    **options
        Any of the following.

        - ``name`` (str): Name of the model. Default: from the file, or the file's own name.
        - ``model`` (str): Model of an SDF world. Default: the only one that moves.
        - ``key`` (str): Keyframe of an MJCF that the model begins in. Default: the first; ``""``: the reference
          pose.
        - ``base`` ({"fixed", "free"}): How the root of a URDF is attached to the ground. Default: fixed. SDF and MJCF
          specify it.
        - ``keep_fixed`` (bool): Keep links on fixed joints as bodies. Otherwise they are merged with the body that
          carries them.
        - ``repair`` (bool): Replace inertias that no body can have by the nearest possible ones, and fix joints that
          move nothing.
        - ``free_mimic`` (bool): Leave mimic joints independent.
        - ``motors`` (bool): Make an input of the force along each degree of freedom of the joints.
        - ``exact_angles`` (bool): Replace angles of a URDF or SDF that look like rounded multiples of pi/12 by these:
          1.5708 by pi/2.
        - ``parameterize`` (str, mapping or list of str): Numbers that become parameters:
          ``"arm:length,forearm:mass"``, or ``{"arm": ["length"]}``.
        - ``loops`` (str or path): A model file with a section ``loops`` to add, or a ``robot.yaml`` of Gepetto. One
          in the folder of a URDF is always read.
        - ``package_paths`` (sequence of str or path): Folders of the packages that the file names by ``package://``
          and ``model://``. Other files are read only from these and from the folder of the robot file.
        - ``folder`` (str or path): Folder that the model's names of mesh files start from. Default: that of the robot
          file.

    Returns
    -------
    Imported
        The model, its text, and the parts that were left out.

    Raises
    ------
    ModelError
        If the file has errors. The exception lists all of them with their lines.

    Examples
    --------
    >>> urdf = '''<robot name="swing"><link name="base"/><link name="arm"><inertial>
    ...   <origin xyz="0 0 -0.5"/><mass value="2"/>
    ...   <inertia ixx="0.1" iyy="0.1" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
    ... <joint name="hinge" type="continuous"><parent link="base"/><child link="arm"/>
    ...   <axis xyz="0 1 0"/></joint></robot>'''
    >>> with open("swing.urdf", "w") as file:
    ...     _ = file.write(urdf)
    >>> found = ordernm.import_model("swing.urdf")
    >>> found.model.coordinate_names, found.joints
    (('arm',), {'hinge': 'arm'})
    """
    # long: the docstring describes every option
    chosen = options_of(options)
    file = file_name(path, "the path of a robot file", "this is the text of a file; the path of a robot file is needed")
    for folder in chosen.package_paths:
        if not os.path.isdir(folder):
            message = f"{os.fspath(folder)} is not a folder; give a folder of packages, or leave it out"
            raise ModelError([Problem(file, None, None, "--package-path", message)])
    _check_loops(chosen)
    data = read_robot_file(file)
    root = parse_xml(data, file)
    files = Files(Path(file), chosen.package_paths)
    with np.errstate(all="ignore"):  # overflow is reported by `check_finite`
        return imported(_read(root, files, chosen), chosen, os.path.basename(file))


def from_pinocchio(model: Any, **options: Any) -> Imported:
    """Make a model from a model of Pinocchio.

    Parameters
    ----------
    model : pinocchio.Model
        The robot.
    **options
        Options of `import_model` that do not concern files.

    Returns
    -------
    Imported
        The model, its text, and the parts that were left out.

    Examples
    --------
    >>> import pinocchio  # doctest: +SKIP
    >>> found = ordernm.from_pinocchio(pinocchio.buildSampleModelManipulator())  # doctest: +SKIP
    """
    from .pinocchio import read_pinocchio

    with np.errstate(all="ignore"):  # overflow is reported by `check_finite`
        chosen = _of_object(options, "pinocchio.Model", ("base", "key", "exact_angles", "package_paths"))
        return imported(read_pinocchio(model), chosen, "A model of Pinocchio")


def from_mujoco(model: Any, **options: Any) -> Imported:
    """Make a model from a model of MuJoCo.

    Parameters
    ----------
    model : mujoco.MjModel
        The robot.
    **options
        Options of `import_model` that do not concern files.

    Returns
    -------
    Imported
        The model, its text, and the parts that were left out.

    Examples
    --------
    >>> import mujoco  # doctest: +SKIP
    >>> found = ordernm.from_mujoco(mujoco.MjModel.from_xml_path("robot.xml"))  # doctest: +SKIP
    """
    from .mjcf import read_mujoco

    with np.errstate(all="ignore"):  # overflow is reported by `check_finite`
        chosen = _of_object(options, "MjModel", ("base", "exact_angles", "package_paths"))
        return imported(read_mujoco(model, chosen.key), chosen, "A model of MuJoCo")


def _read(root: Element, files: Files, options: Options) -> Robot:
    if root.tag == "robot":
        from .urdf import read_urdf

        robot = read_urdf(root, files, options.exact_angles)
        robot.format = "URDF"
        _refuse(root, "--model", options.model, "for SDF worlds, which may have several models; a URDF has one")
        _refuse(root, "--key", options.key, "for MJCF, which has keyframes")
        if options.loops is None and (found := beside(root.file)) is not None and not files.forbidden(found):
            options = replace(options, loops=found)
        if options.loops is not None and is_gepettos(options.loops):
            apply_gepetto(robot, options.loops)
            robot.notes.append(f"Loops and types of joints of {os.path.basename(options.loops)}.")
        put_on_ground(robot, options.base or "fixed")
        return robot
    if root.tag in ("mujoco", "mujocoinclude"):
        from .mjcf import read_mjcf

        _refuse(root, "--base", options.base, "for URDF; an MJCF specifies what is attached to the ground")
        if options.exact_angles:
            raise ModelError(
                [root.problem("--exact-angles is for URDF and SDF; MJCF has degrees or quaternions: leave it out")]
            )
        _refuse(root, "--model", options.model, "for SDF worlds, which may have several models; an MJCF is one model")
        return read_mjcf(root, Path(root.file), files, options.key)
    if root.tag == "sdf":
        from .sdf import read_sdf

        _refuse(root, "--base", options.base, "for URDF; an SDF specifies what is attached to the ground")
        _refuse(root, "--key", options.key, "for MJCF, which has keyframes")
        return read_sdf(root, files, options.exact_angles, options.model)
    expected = ", ".join(f"<{tag}> ({name})" for tag, name in FORMATS.items())
    raise ModelError([root.problem(f"the root element is <{root.tag}>; allowed are {expected}")])


def _refuse(root: Element, option: str, value: str | None, what: str) -> None:
    if value is not None:
        raise ModelError([root.problem(f"{option} {value} is {what}; leave it out")])


def _of_object(options: dict[str, Any], file: str, others: Sequence[str]) -> Options:
    """The options of the import of an object; raises an error for options about files."""
    wrong = [name for name in others if options.get(name)]
    if wrong:
        message = "applies to files only; leave it out"
        raise ModelError([Problem(file, None, None, name, message) for name in wrong])
    chosen = options_of(options)
    _check_loops(chosen)
    return chosen


def _check_loops(chosen: Options) -> None:
    """Raises an error if the file of loops is no regular file, but a named pipe, for example."""
    message = None if chosen.loops is None else no_regular_file(chosen.loops)
    if chosen.loops is not None and message is not None:
        said = f"cannot be read: {message}; give a YAML file with a section loops"
        raise ModelError([Problem(os.fspath(chosen.loops), 1, 1, "", said)])


def imported(robot: Robot, options: Options, source: str) -> Imported:
    """The model of a robot in which every link leads to the ground.

    Parameters
    ----------
    robot : Robot
    options : Options
    source : str
        Origin of the robot, for the comment at the top of the file.
    """
    _check_options(robot, options)
    problems: list[Problem] = []
    names = names_for(robot.links)
    taken = set(names.values())
    for closing in robot.closings:  # loops and bodies share one set of names
        closing.name = free_name(closing.name, taken)
        taken.add(closing.name)
    is_side = options.loops is not None and not is_gepettos(options.loops)
    if options.loops is not None and not is_side and robot.format != "URDF":
        message = "Gepetto's robot.yaml is for URDF; write the loops in the model format"
        raise ModelError([Problem(os.fspath(options.loops), 1, 1, "", message)])
    side = read_side_file(options.loops, robot, names) if is_side and options.loops is not None else SideFile()
    problems += _mimic(robot, options)
    held = {link for closing in robot.closings for link, _ in (closing.start, closing.end)} | side.links
    held |= {robot.joints[name].child for c in robot.couplings for name in (c.joint, c.of)}
    problems += fix_massless(robot, held, options.repair)
    bodies = merged_bodies(robot, options.keep_fixed, side.links)
    if not bodies.all:
        instead = ", or --base free to the root" if robot.format == "URDF" else ""
        message = f"everything is fixed to the ground, so nothing moves; give a link a joint that moves{instead}"
        problems.append(Problem(robot.file, None, None, "", message))
    too_large = check_finite(robot, bodies)
    problems += too_large or check_inertias(robot, bodies, options.repair)
    parameters = Parameters()
    problems += parameters.ask(requested_words(options.parameterize), bodies, names, robot.file)
    problems += _check_lifted(robot, bodies)
    if any(p.severity == "error" for p in problems):
        raise ModelError(sorted(problems, key=lambda p: (p.severity != "error", p.line or 0)))
    robot.warnings += problems
    _lift(robot, bodies)
    head = _head(robot, bodies, names, source)
    name = model_name(robot.name) if options.name is None else options.name
    folder = os.path.dirname(robot.file) if options.folder is None else os.fspath(options.folder)
    writer = ModelWriter(robot, bodies, name, names, parameters, head, side.sections, options.motors, folder)
    text = writer.text()
    model = _checked(text, robot, bodies, names, side)
    return Imported(
        text=text,
        model=model,
        left_out=tuple(map(str, robot.listed())),
        differences=tuple(str(entry) for entry in robot.listed() if entry.effect is Effect.DIFFERS),
        warnings=tuple(str(p) for p in robot.warnings),
        bodies={link: writer.names[holder] for link, (holder, _) in bodies.holders.items() if link},
        frames={link: (writer.names[holder], own.at, own.rpy) for link, holder, own in bodies.merged_frames()},
        joints={
            b.joint.name: names[link] for link, b in bodies.all.items() if b.joint.name and b.joint.type != "fixed"
        },
        renamed={link: new for link, new in names.items() if link != new},
    )


def _check_options(robot: Robot, options: Options) -> None:
    """Raise an error for options with impossible values."""
    if options.base not in (None, *BASES):
        raise ModelError(
            [Problem(robot.file, None, None, "base", f"{options.base!r} is unknown; {' or '.join(BASES)} is allowed")]
        )
    if options.name is not None and not names_a_model(options.name):
        message = f"{options.name!r} cannot name a model; use a lower-case identifier such as four_bar"
        raise ModelError([Problem(robot.file, None, None, "--name", message)])


def _check_lifted(robot: Robot, bodies: Bodies) -> list[Problem]:
    """Errors for masses and centres of mass that cannot become parameters, since a constant force carries the weight."""
    found = []
    for name in robot.lifted:
        body = bodies.all.get(bodies.holders[name][0])
        if body is not None and body.words & {"mass", "com"}:
            message = f"the weight of link {shortened(name)} is carried by a force that would not follow a parameter"
            found.append(robot.links[name].place.problem(f"{message}; leave its mass and com out of --parameterize"))
    return found


def _lift(robot: Robot, bodies: Bodies) -> None:
    """Adds forces that carry part of the weight of links, each at the centre of mass of the link."""
    for name, part in robot.lifted.items():
        inertia = robot.links[name].inertia
        if bodies.holders[name][0] == WORLD or inertia.mass * part == 0 or not any(robot.gravity):
            continue
        mark = f"{name} com"
        robot.marks.append(Mark(mark, name, inertia.com))
        value = vector(-part * inertia.mass * g for g in robot.gravity)
        robot.forces.append(BodyForce(f"{name} lift", f"type: force, on: {{}}, value: {value}", (mark,)))


def _mimic(robot: Robot, options: Options) -> list[Problem]:
    """Turns mimic joints into couplings; returns errors for joints without a coupling, unless --free-mimic is set."""
    found, kept = [], []
    for coupling in robot.couplings:
        what = f"joint {shortened(coupling.joint)} {coupling.unreadable or f'follows {shortened(coupling.of)}'}"
        if options.free_mimic:
            kind = "gears" if coupling.is_gear else "<mimic>"
            robot.leave_out(kind, coupling.place, Effect.DIFFERS, "--free-mimic leaves the joints independent")
        elif coupling.joint in robot.joints and robot.joints[coupling.joint].type == "fixed":
            robot.leave_out("<mimic> of a fixed joint", coupling.place, Effect.NONE)
        elif why := _why_no_coupling(robot, coupling):
            found.append(coupling.place.problem(f"{what}, {why}"))
        else:
            kept.append(coupling)
    robot.couplings = kept
    return found


def _why_no_coupling(robot: Robot, coupling: Coupling) -> str:
    """The reason why a joint cannot follow another, and the remedy; empty if it can."""
    if coupling.unreadable:
        return "which is not read; --free-mimic leaves it out"
    if coupling.of not in robot.joints:
        return "which is not a joint of this file; name one that is"
    if coupling.of == coupling.joint:
        return "which is the same joint; name another one"
    if coupling.ratio == 0:
        return "with a multiplier of 0, so that it does not move; make it a fixed joint"
    for name in (coupling.joint, coupling.of):
        if robot.joints[name].type not in SINGLE:
            is_what = f"joint {shortened(name)} is {robot.joints[name].type}"
            return (
                f"but {is_what}, and only {', '.join(SINGLE)} joints can follow each other; --free-mimic leaves it out"
            )
    return ""


def _head(robot: Robot, bodies: Bodies, names: Mapping[str, str], source: str) -> list[str]:
    """The comment at the top of the model file: the origin, and what the import left out."""
    lines = [f"{one_line(source)}, imported by ordernm.", *map(one_line, robot.notes)]
    if bodies.grounded and any(not link.inertia.is_nothing for link, _ in bodies.grounded):
        mass = reduce(exact_sum, (link.inertia.mass for link, _ in bodies.grounded))
        fixed_links = ", ".join(one_line(link.name) for link, _ in bodies.grounded)
        lines.append(f"Fixed to the ground: {fixed_links}, {number(mass)} kg.")
    if renamed := sum(names[link] != link for link in robot.links):
        lines.append(f"Renamed: {renamed} of {len(names)} links; their original names are in comments.")
    fixed = [w.message for w in robot.warnings if w.message.endswith(FIXED)]
    if fixed:
        lines += ["Repaired:", *_entries(fixed)]
    if robot.left_out:
        lines += ["Left out:", *_entries(map(str, robot.listed()))]
    return [part for line in lines for part in (wrapped(line) if not line.startswith(" ") else [line])]


def _entries(texts: Iterable[str]) -> list[str]:
    """Lines of a comment, one for each entry of a list."""
    return [f"  {part}" for text in texts for part in wrapped(one_line(text, 1000))]


def _checked(text: str, robot: Robot, bodies: Bodies, names: Mapping[str, str], side: SideFile) -> Model:
    """The model of a text; its errors refer to the robot's file."""
    try:
        return parse_model(text, robot.file)
    except ModelError as error:
        by_name = {names[link]: body for link, body in bodies.all.items()}
        closings = {closing.name: closing.place for closing in robot.closings}
        found = []
        for problem in error.problems:
            section, _, rest = problem.path.partition(".")
            name = rest.partition(".")[0]
            if problem.path.startswith(("bodies.", "forces.")) and name in by_name:
                place = by_name[name].link.place
                found.append(
                    place.problem(f"link {shortened(by_name[name].link.name)}: {problem.message}", problem.severity)
                )
            elif section == "loops" and name in closings:
                found.append(closings[name].problem(f"loop {shortened(name)}: {problem.message}", problem.severity))
            elif section.partition("[")[0] in side.sections:
                found.append(side.problem(problem))
            else:
                found.append(Problem(robot.file, None, None, problem.path, problem.message, problem.severity))
        raise ModelError(found) from None
