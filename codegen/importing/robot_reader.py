"""What reading a URDF and reading an SDF have in common: where they begin, and how they end."""

from __future__ import annotations

from abc import ABC, abstractmethod

from ..model import ModelError
from .files import Files
from .robot import Robot
from .xml_reading import Element
from .xml_values import Values


class RobotReader(Values, ABC):
    """Reads the robot of a file; each format's reader fills `robot` in its `read`.

    Attributes
    ----------
    root : Element
    files : Files
        Finds what the file names.
    robot : Robot

    Parameters
    ----------
    root : Element
        Of the file.
    files : Files
    exact_angles : bool
        Whether 1.5708 means pi/2.
    """

    def __init__(self, root: Element, files: Files, exact_angles: bool) -> None:
        super().__init__(exact_angles)
        self.root = root
        self.files = files
        self.robot = Robot("robot", root.file)

    @abstractmethod
    def read(self) -> None:
        """Fill `robot`, and gather what is wrong."""

    @abstractmethod
    def leave_out(self, element: Element) -> None:
        """List an element that has no place in a model."""

    def whole(self) -> Robot:
        """The robot of the file.

        Raises
        ------
        ModelError
            With every problem of the file, in its order.
        """
        self.read()
        if self.problems:
            once = {str(problem): problem for problem in self.problems}
            raise ModelError(sorted(once.values(), key=lambda p: (p.line or 0, p.column or 0)))
        return self.robot
