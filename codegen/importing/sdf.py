"""Import of SDF: links with poses of their own, and joints between them that may close loops, see http://sdformat.org/spec.

The components of an axis are in the joint's frame, or in the frame that ``expressed_in`` names. In files before 1.5,
and with ``use_parent_model_frame``, the components are in the model's frame. See `sdf_scopes` for worlds and nested
models, `sdf_frames` for poses and frames, and `sdf_tree` for the choice of the tree's joints.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from ..model.positions import shortened
from .files import Files
from .robot import Effect, Inertia, Link, Robot, as_three, symmetric
from .sdf_choice import Choice
from .sdf_frames import Frames
from .sdf_joints import JointReader, SdfJoint
from .sdf_scopes import NAMED, Item, Scope, Scopes
from .sdf_shapes import ShapeReader
from .sdf_tree import TreeMaker
from .xml_reading import Element
from .xml_values import RobotReader, is_true, is_version, place_of, version_of

_LINK: Final = {"pose", "inertial", "visual", "collision", "gravity"}
_MODEL: Final = {"pose", "static", "model", "include", *NAMED}
_GRAVITY: Final = (0.0, 0.0, -9.8)
"""Gravity of a world that does not specify it, m/s^2."""
_REMARKS: Final = {
    "light": ("", Effect.NONE), "sensor": ("sensors", Effect.NONE), "plugin": ("code of a simulator", Effect.UNKNOWN),
    "scene": ("", Effect.NONE), "gui": ("", Effect.NONE), "audio": ("", Effect.NONE), "audio_source": ("", Effect.NONE),
    "audio_sink": ("", Effect.NONE), "actor": ("", Effect.NONE), "physics": ("settings of a simulator", Effect.NONE),
    "magnetic_field": ("", Effect.NONE), "atmosphere": ("", Effect.NONE), "spherical_coordinates": ("", Effect.NONE),
    "wind": ("the wind", Effect.DIFFERS), "enable_wind": ("the wind", Effect.UNKNOWN), "road": ("", Effect.NONE),
    "state": ("poses of a saved state; the model begins in those of its links", Effect.NONE),
    "population": ("models that a simulator adds", Effect.DIFFERS), "battery": ("", Effect.NONE),
    "self_collide": ("contacts", Effect.STOPS), "allow_auto_disable": ("a simulator may stop bodies at rest", Effect.NONE),
    "must_be_base_link": ("", Effect.NONE), "projector": ("", Effect.NONE), "particle_emitter": ("", Effect.NONE),
    "kinematic": ("a link that the simulator moves itself", Effect.DIFFERS), "material": ("", Effect.NONE),
    "velocity_decay": ("damping of a link", Effect.DIFFERS), "gripper": ("contacts", Effect.STOPS),
    "fluid_added_mass": ("the added mass of a fluid", Effect.DIFFERS), "surface": ("contacts", Effect.STOPS),
    "max_contacts": ("contacts", Effect.STOPS), "laser_retro": ("", Effect.NONE), "cast_shadows": ("", Effect.NONE),
    "transparency": ("", Effect.NONE), "meta": ("", Effect.NONE), "visibility_flags": ("", Effect.NONE),
    "drake:linear_bushing_rpy": ("a force of Drake's", Effect.DIFFERS),
    "drake:ball_constraint": ("a constraint of Drake's", Effect.DIFFERS),
    "drake:joint": ("a joint of Drake's", Effect.DIFFERS),
    "drake:collision_filter_group": ("contacts", Effect.STOPS), "drake:proximity_properties": ("contacts", Effect.STOPS),
    "drake:illustration_properties": ("", Effect.NONE), "drake:visual": ("", Effect.NONE),
    "drake:perception_properties": ("", Effect.NONE), "drake:diffuse_map": ("", Effect.NONE),
    "drake:capsule": ("", Effect.STOPS), "drake:ellipsoid": ("", Effect.STOPS),
}  # fmt: skip
"""Elements that the model format lacks, each with a remark and the effect of its absence."""


_LATEST: Final = (1, 12)
_SWITCHES: Final = ("wind", "enable_wind", "kinematic", "velocity_decay", "self_collide")


def _is_off(element: Element) -> bool:
    """Whether all texts in an element and its children are zero or false."""
    words = element.text.lower().split()
    own = all(word == "false" or word.strip("+-0.") == "" for word in words)
    return own and all(map(_is_off, element.children))


def _models_of(world: Element) -> list[str]:
    """The names of the models of a world; an <include> without <name> is skipped."""
    given = [name.text.strip() for include in world.all("include") for name in include.all("name")]
    return [*(model.attributes.get("name", "").strip() for model in world.all("model")), *given]


def read_sdf(root: Element, files: Files, exact_angles: bool = False, chosen: str | None = None) -> Robot:
    """The robot of an SDF file; with `exact_angles`, 1.5708 is taken as pi/2.

    Parameters
    ----------
    root : Element
    files : Files
    exact_angles : bool
    chosen : str, optional
        The model to read, together with the world's joints that hold it.

    Raises
    ------
    ModelError
        If the file has errors. The exception lists all of them.
    """
    return _Reader(root, files, exact_angles, chosen).whole()


class _Reader(RobotReader):
    remarks = _REMARKS

    def __init__(self, root: Element, files: Files, exact_angles: bool, chosen: str | None) -> None:
        super().__init__(root, files, exact_angles)
        self.chosen = chosen
        self.scopes = Scopes(files, self.wrong, self.problems, self.leave_out)
        self.frames = Frames(self)
        self.shapes = ShapeReader(self, self.frames)
        self.joint_reader = JointReader(self, self.frames)

    def read(self) -> None:
        world = self.world()
        choice = Choice(self, self.frames, world)
        read = choice.scopes(self.chosen)
        if not read:
            return
        self.leave_out_rest(world, set(read), choice)
        base = choice.base(read)
        prefix = choice.paths[base]
        self.robot.name = base.name or world.name or Path(self.root.file).stem
        joints: dict[str, SdfJoint] = {}
        static: set[str] = set()
        for scope in read:
            for item in scope.items.values():
                if item.element.tag == "link":
                    full = choice.paths[scope].removeprefix(prefix) + item.name
                    self.robot.links[full] = self.link(scope, item, full)
                    if scope.is_fixed:
                        static.add(full)
        for scope, item in choice.joints(read):
            path = choice.paths[scope]
            cut = "" if path.startswith(prefix) else prefix  # for joints outside the base model, see `SdfJoint.cut`
            self.joint(scope, item, path if cut else path.removeprefix(prefix), cut, joints)
        if not self.robot.links and not self.problems:
            self.wrong(base.element, 'no <link>; a model has at least one, such as <link name="arm"/>')
        if not self.problems:
            maker = TreeMaker(self, self.frames, base, static)
            maker.put_together(joints, {n: self.frames.named(base, n, base.element) for n in self.robot.links})

    # ---- models --------------------------------------------------------------------------------------------------------

    def world(self) -> Scope:
        """The scope of the world, or of a file that has models only."""
        said = self.root.attributes.get("version", "")
        version = version_of(said or "1.0")
        if not is_version(said) or version > _LATEST:
            read = (
                "versions up to 1.12 are known"
                if is_version(said)
                else "read as 1.0, in which axes are given in the model's frame"
            )
            message = f"the version of <sdf> is {shortened(said) if said else 'left out'}; {read}"
            self.robot.warnings.append(self.root.problem(message, "warning"))
        worlds = list(self.root.all("world"))
        if not worlds:
            return self.scopes.world(self.root, version)
        wanted = self.chosen
        named = [w for w in worlds if wanted is not None and w.attributes.get("name") == wanted]
        outermost = wanted.partition("::")[0] if wanted is not None else None
        named += [w for w in worlds if outermost is not None and outermost in _models_of(w)]
        for other in worlds[1:] if not named else [w for w in worlds if w is not named[0]]:
            self.robot.leave_out("a further <world>", other.line, Effect.NONE, "only the first is read")
        chosen = named[0] if named else worlds[0]
        gravity = chosen.first("gravity")
        if gravity is None:
            said = "the world has no <gravity>; SDF's default 0 0 -9.8 m/s^2 is used"
            self.robot.warnings.append(chosen.problem(said, "warning"))
        self.robot.gravity = as_three(self.content(gravity, 3, _GRAVITY))
        return self.scopes.world(chosen, version)

    def remark_of(self, element: Element) -> tuple[str, Effect]:
        what, effect = super().remark_of(element)
        return what, Effect.NONE if element.tag in _SWITCHES and _is_off(element) else effect

    def leave_out_rest(self, scope: Scope, read: set[Scope], choice: Choice) -> None:
        """List the unread parts of a world, or of a model that is read in part."""
        known = (*_MODEL, "gravity", "world") if scope.is_world else _MODEL
        self.leave_out_children(scope.element, known)
        for model in scope.models.values():
            if any(inner in read for _, inner in model.all()):
                self.leave_out_rest(model, read, choice)
            elif model.is_fixed:
                self.robot.leave_out("static <model>", place_of(model.element), Effect.STOPS)
            else:
                what = f"--model {choice.paths[model].removesuffix('::')} reads it"
                self.robot.leave_out("another <model>", place_of(model.element), Effect.NONE, what)
        if not scope.is_world and scope not in read:
            name = choice.paths[scope].removesuffix("::")
            what = f"a model within it is read; --model {name} reads it whole"
            self.robot.leave_out("the rest of a <model>", place_of(scope.element), Effect.NONE, what)

    # ---- elements ------------------------------------------------------------------------------------------------------

    def link(self, scope: Scope, item: Item, name: str) -> Link:
        element = item.element
        link = Link(name, place_of(element))
        self.leave_out_children(element, _LINK)
        solids = [(e, self.shapes.solid(scope, item, e)) for e in element.all("visual", "collision")]
        link.solids += [solid for _, solid in solids if solid is not None]
        inertial = self.one(element, "inertial")
        if inertial is None:
            link.inertia = Inertia(1.0, (0.0, 0.0, 0.0), np.eye(3))
            message = f"link {shortened(name)} has no <inertial>; SDF's default is 1 kg and 1 kg m^2 about every axis"
            self.robot.warnings.append(element.problem(message, "warning"))
        elif is_true(inertial.attributes.get("auto", "")):
            link.inertia = self.shapes.of_collisions(inertial, [(e, s) for e, s in solids if e.tag == "collision"])
        else:
            link.inertia = self.inertia(inertial)
        gravity = element.first("gravity")
        if gravity is not None and not is_true(gravity.text):
            self.robot.lifted[name] = 1.0
        return link

    def color(self, shown: Element) -> str:
        material = shown.first("material")
        diffuse = None if material is None else material.first("diffuse")
        if material is None:
            return ""
        return self.hex_color("" if diffuse is None else diffuse.text, material)

    def inertia(self, element: Element) -> Inertia:
        self.leave_out_children(element, ("pose", "mass", "inertia", "density", "auto_inertia_params"))
        pose = self.one(element, "pose")
        if pose is not None and "relative_to" in pose.attributes:
            self.robot.leave_out(
                "attribute 'relative_to' in <inertial>", place_of(pose), Effect.UNKNOWN, "SDF has none there"
            )
        frame = self.frames.pose(pose)
        mass = self.content(self.one(element, "mass"), 1, (1.0,))[0]
        if mass < 0:
            self.wrong(element, f"the mass is {mass:g}; at least 0 kg is needed")
        inertia = self.one(element, "inertia")
        six = [0.0] * 6
        for k, key in enumerate(("ixx", "iyy", "izz", "ixy", "ixz", "iyz")):
            found = self.one(inertia, key) if inertia is not None else None
            six[k] = self.content(found, 1, (1.0 if k < 3 else 0.0,))[0]
        return Inertia(mass, (0.0, 0.0, 0.0), symmetric(*six)).seen_from(frame)

    def joint(self, scope: Scope, item: Item, path: str, cut: str, joints: dict[str, SdfJoint]) -> None:
        joint = self.joint_reader.read(scope, item, path, cut)
        if joint is None:
            return
        if joint.name in joints:
            where = place_of(joints[joint.name].element).line
            self.wrong(
                item.element, f"name {shortened(joint.name)} is already used in line {where}; give one another name"
            )
        joints[joint.name] = joint
