"""Numbers and names in XML attributes and text, with their errors, and the common base of the URDF and SDF readers."""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import ClassVar, Final

from ..model import ModelError
from ..model.errors import Problem, nearest
from ..model.positions import shortened
from ..model.sections.digits import cut_twelfths
from .files import Files
from .placement import Array, Placement, of_quaternion, pi_multiple
from .robot import VISIBLE, Effect, Place, Robot, Solid
from .xml_reading import Element

_NUMBER: Final = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_LARGEST: Final = 1e150
"""Largest number accepted; its square is still finite."""
_LONGEST: Final = 400
"""Largest length of the text of a number."""


class Values:
    """Reads values of elements and collects the errors.

    Attributes
    ----------
    problems : list of Problem

    Parameters
    ----------
    exact_angles : bool
        Whether 1.5708 is taken as pi/2.
    """

    def __init__(self, exact_angles: bool = False) -> None:
        self.problems: list[Problem] = []
        self.exact_angles = exact_angles

    def wrong(self, element: Element, message: str) -> None:
        """Report an error about an element."""
        self.problems.append(element.problem(message))

    def numbers(self, element: Element, what: str, text: str, count: int) -> tuple[float, ...] | None:
        """The numbers in a text, of which there must be `count`; None after an error."""
        parts = text.split()
        named = f"{what} of <{element.tag}>"
        hint = "; expand the file with xacro first: xacro FILE > robot.urdf" if "${" in text or "$(" in text else ""
        if len(parts) != count:
            needed = "a number is needed" if count == 1 else f"{count} numbers with blanks between them are needed"
            self.wrong(element, f"{named} is {shortened(text.strip())}; {needed}{hint}")
            return None
        found = []
        for part in parts:
            value = float(part) if len(part) <= _LONGEST and _NUMBER.fullmatch(part) else math.nan
            if not math.isfinite(value):
                self.wrong(
                    element, f"{named} holds {shortened(part)}; a finite number such as 0.5 or 1e-3 is needed{hint}"
                )
                return None
            found.append(value)
        return tuple(found)

    def attribute(self, element: Element, key: str, count: int, default: Sequence[float]) -> tuple[float, ...]:
        """Numbers of an attribute; the default if it is absent or wrong."""
        text = element.attributes.get(key)
        if text is None:
            return tuple(default)
        found = self.numbers(element, key, text, count)
        return tuple(default) if found is None else found

    def angles(self, values: Sequence[float]) -> tuple[float, ...]:
        """Angles; with `exact_angles`, angles close to multiples of pi/12 become exact."""
        return tuple(pi_multiple(cut_twelfths(v)) or v for v in values) if self.exact_angles else tuple(values)

    def number(self, element: Element, key: str, default: float | None = 0.0) -> float:
        """A number of an attribute, which is required if there is no default."""
        if default is None and key not in element.attributes:
            self.wrong(element, f'<{element.tag}> has no {key}; {key}="..." is needed')
            return 0.0
        return self.attribute(element, key, 1, (default or 0.0,))[0]

    def quaternion(self, element: Element, wxyz: Sequence[float]) -> Array:
        """The rotation of a quaternion; an error is reported if all its components are zero."""
        size = math.sqrt(sum(v * v for v in wxyz)) if max(map(abs, wxyz)) < _LARGEST else math.inf
        if not 0 < size < math.inf:
            self.wrong(element, "the quaternion is 0 0 0 0 or too large; x y z w of length 1 are needed")
            return of_quaternion(1.0, 0.0, 0.0, 0.0)
        w, x, y, z = (float(v) for v in wxyz)
        return of_quaternion(w, x, y, z)

    def content(self, element: Element | None, count: int, default: Sequence[float]) -> tuple[float, ...]:
        """Numbers in an element's text; the default if the element is None or wrong."""
        if element is None:
            return tuple(default)
        found = self.numbers(element, "the text", element.text, count)
        return tuple(default) if found is None else found

    def name(self, element: Element, key: str = "name") -> str | None:
        """A name in an attribute; None after an error."""
        text = element.attributes.get(key, "").strip()
        if not text:
            self.wrong(element, f'<{element.tag}> has no {key}; {key}="..." is needed')
            return None
        return text

    def new_name(self, element: Element, known: dict[str, Place], what: str) -> str | None:
        """A name that is not used yet, which is added to `known`; None after an error."""
        name = self.name(element)
        if name is None:
            return None
        if name in known:
            where = f" in line {known[name].line}" if known[name].line else ""
            self.wrong(element, f"{what} {shortened(name)} is already used{where}; every {what} needs a different name")
            return None
        known[name] = place_of(element)
        return name

    def one(self, element: Element, tag: str) -> Element | None:
        """The only child with a tag; an error if there are several."""
        found = list(element.all(tag))
        for other in found[1:]:
            self.wrong(
                other, f"a second <{tag}> in <{element.tag}>; one is allowed, the first is in line {found[0].line}"
            )
        return found[0] if found else None

    def unknown(self, element: Element, what: str, name: str, known: Sequence[str]) -> None:
        """Report an unknown name."""
        shown = ", ".join(known[:8]) + (", ..." if len(known) > 8 else "")
        self.wrong(
            element, f"{what} {shortened(name)} is not in this file; known are {shown or 'none'}{nearest(name, known)}"
        )


class RobotReader(Values, ABC):
    """Base class of the URDF and SDF readers, whose `read` methods fill `robot`.

    Attributes
    ----------
    root : Element
    files : Files
        Finds the files that the robot's file names.
    robot : Robot
    remarks : mapping
        For the tag of each element that the model format lacks: a remark, and the effect of leaving the element out.

    Parameters
    ----------
    root : Element
        Root element of the file.
    files : Files
    exact_angles : bool
        Whether 1.5708 is taken as pi/2.
    """

    remarks: ClassVar[Mapping[str, tuple[str, Effect]]] = {}

    def __init__(self, root: Element, files: Files, exact_angles: bool) -> None:
        super().__init__(exact_angles)
        self.root = root
        self.files = files
        self.robot = Robot("robot", root.file)

    @abstractmethod
    def read(self) -> None:
        """Read the file: fill `robot`, and collect the errors."""

    def remark_of(self, element: Element) -> tuple[str, Effect]:
        """The remark about an element that the model format lacks, and the effect of leaving the element out."""
        return self.remarks.get(element.tag, ("", Effect.UNKNOWN))

    def leave_out(self, element: Element, remarks: Mapping[str, tuple[str, Effect]] | None = None) -> None:
        """List an element as left out; its remark is from `remarks` or from the reader's own table."""
        what, effect = self.remark_of(element) if remarks is None else remarks.get(element.tag, ("", Effect.UNKNOWN))
        self.robot.leave_out(f"<{element.tag}>", place_of(element), effect, what)

    def leave_out_children(
        self, element: Element, known: Collection[str], remarks: Mapping[str, tuple[str, Effect]] | None = None
    ) -> None:
        """Lists the unknown children of an element as left out."""
        for child in element.children:
            if child.tag not in known:
                self.leave_out(child, remarks)

    def type_of(self, element: Element, what: str, known: Collection[str], are: str = "are joints") -> str | None:
        """The type in an element's attribute; None after an error."""
        type_ = self.name(element, "type")
        if type_ is None or type_ in known:
            return type_
        self.wrong(element, f"{what} is {shortened(type_)}; {', '.join(known)} {are}{nearest(type_, known)}")
        return None

    def primitive(
        self, shown: Element, frame: Placement, sizes: Mapping[str, Sizes], file: str, scale: Sizes
    ) -> Solid | None:
        """The solid or mesh in the <geometry> of a <visual>, or the solid of a <collision>; other shapes are listed as left out.

        Parameters
        ----------
        shown : Element
        frame : Placement
            Pose of its centre in the link.
        sizes : dict of str to callable
            For each type of solid, the function that reads its sizes.
        file : str
            The attribute or child of <mesh> that names its file.
        scale : callable
            Reads the three scale factors of a <mesh>.
        """
        geometry, effect = self.one(shown, "geometry"), shown_effect(shown)
        is_visual = shown.tag == "visual"
        for child in geometry.children if geometry is not None else ():
            if child.tag == "mesh":
                uri = child.first(file)
                name = uri.text.strip() if uri is not None else child.attributes.get(file, "")
                missing = self.files.missing(name) if is_visual else None  # nothing reads a mesh for collisions
                if is_visual and missing is None:
                    return Solid("mesh", scale(self, child), frame, True, self.color(shown), str(self.files.find(name)))
                why = f", {missing}" if missing else ""
                self.robot.leave_out(f"<{shown.tag}> of a mesh{why}", place_of(child), effect)
                continue
            if not (is_visual and child.tag in VISIBLE):
                self.robot.leave_out(f"<{shown.tag}> of a {child.tag}", place_of(child), effect)
            if child.tag in sizes:
                return Solid(
                    child.tag, sizes[child.tag](self, child), frame, is_visual, self.color(shown) if is_visual else ""
                )
        return None

    def color(self, shown: Element) -> str:
        """Colour of a <visual>, ``#rrggbbaa``; ``""`` if it has none."""
        return ""

    def hex_color(self, text: str, material: Element) -> str:
        """The colour of a material, by the function `hex_color`; an invalid one is listed as left out."""
        color = hex_color(text)
        if not color:
            name = material.attributes.get("name", "")
            what = f"<material>{f' {shortened(name)}' if name else ''} without a valid colour"
            self.robot.leave_out(what, place_of(material), Effect.NONE)
        return color

    def whole(self) -> Robot:
        """Read the whole robot.

        Raises
        ------
        ModelError
            If the file has errors. The exception lists all of them in the order of their lines.
        """
        self.read()
        if self.problems:
            once = {str(problem): problem for problem in self.problems}
            raise ModelError(sorted(once.values(), key=lambda p: (p.line or 0, p.column or 0)))
        return self.robot


def hex_color(text: str) -> str:
    """Colour of three or four numbers from 0 to 1, as ``#rrggbb`` or ``#rrggbbaa``; ``""`` if the text has no such numbers."""
    try:
        numbers = [float(x) for x in text.split()]
    except ValueError:
        return ""
    if len(numbers) not in (3, 4) or not all(0 <= x <= 1 for x in numbers):
        return ""
    shown = numbers[:3] if numbers[3:] == [1.0] else numbers
    return "#" + "".join(f"{round(255 * x):02x}" for x in shown)


Sizes = Callable[[RobotReader, Element], tuple[float, ...]]
"""Reads the sizes of a solid from its element."""


def version_of(text: str) -> tuple[int, int]:
    """Major and minor version: 1.11 is after 1.5; (1, 0) if the text is not a version."""
    parts = text.strip().split(".")
    if not all(part.isdigit() and len(part) < 7 for part in parts):
        return 1, 0
    return int(parts[0]), int(parts[1]) if len(parts) > 1 else 0


def is_version(text: str) -> bool:
    """Whether a text is a version: two integers with a point between them."""
    return re.fullmatch(r"\d{1,6}\.\d{1,6}", text.strip()) is not None


def is_true(text: str) -> bool:
    """Whether a text means true: it is "1" or "true", in any case."""
    return text.strip().lower() in ("1", "true")


def shown_effect(element: Element) -> Effect:
    """The effect on the motion of leaving out a <visual> or a <collision>."""
    return Effect.STOPS if element.tag == "collision" else Effect.NONE


def place_of(element: Element) -> Place:
    """The place of an element in its file."""
    return Place(element.file, element.line, element.column)
