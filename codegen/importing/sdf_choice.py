"""Choice of the models of an SDF world to read: the chosen one, or the only one that moves, with the joints that hold it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from ..model.errors import nearest
from ..model.positions import shortened
from .sdf_frames import Frames
from .sdf_scopes import Item, Scope
from .xml_values import RobotReader

_SHOWN = 12
"""Number of model names that a message lists."""


class Choice:
    """Chooses the models of a world that are read.

    Parameters
    ----------
    reader : RobotReader
        Collects the errors.
    frames : Frames
        Finds the links of joints.
    world : Scope

    Attributes
    ----------
    paths : dict of Scope to str
        Every scope in the order of the file, with the prefix of its names in the world: ``robot::arm::``.
    """

    def __init__(self, reader: RobotReader, frames: Frames, world: Scope) -> None:
        self.reader = reader
        self.frames = frames
        self.world = world
        self.paths = {scope: path for path, scope in world.all()}
        self._joints = list(self._all_joints())

    def scopes(self, chosen: str | None) -> list[Scope]:
        """The scopes to read, in the order of the file; empty after an error.

        Parameters
        ----------
        chosen : str or None
            Name of a model, ``robot`` or ``robot::arm``; None or the name of the world chooses the only model that moves.
        """
        if not self.world.models:
            if not self.reader.problems:
                self.reader.wrong(self.reader.root, 'no <model>; <sdf> needs one, such as <model name="robot">')
            return []
        if chosen is None or chosen == self.world.name:
            return self._only_moving()
        found = next((scope for scope, path in self.paths.items() if path == f"{chosen}::"), None)
        if found is None:
            self._unknown(chosen)
            return []
        return self._held(scope for _, scope in found.all())

    def base(self, read: Iterable[Scope]) -> Scope:
        """The innermost scope that contains all scopes that are read."""
        base, read = self.world, set(read)
        while base not in read:
            inner = [m for m in base.models.values() if any(scope in read for _, scope in m.all())]
            if len(inner) != 1:
                return base
            base = inner[0]
        return base

    def ends(self, scope: Scope, item: Item) -> list[Scope]:
        """The scopes of the two links that a joint connects, without the world."""
        found = []
        for tag in ("parent", "child"):
            end = item.element.first(tag)
            name = end.text.strip() if end is not None else ""
            link = self.frames.link(scope, item.home, name, end) if end is not None and name else None
            inner = scope
            for part in link.split("::")[:-1] if link else ():
                inner = inner.models[part]
            if link and not inner.is_world:
                found.append(inner)
        return found

    def joints(self, read: Sequence[Scope]) -> Iterator[tuple[Scope, Item]]:
        """The joints inside the scopes that are read, and the outside joints that connect to these scopes."""
        found = set(read)
        for scope, item, ends in self._joints:
            # a joint with unknown links is wrong; reading it reports the error
            if any(end in found for end in ends) or (not ends and scope in found):
                yield scope, item

    def _all_joints(self) -> Iterator[tuple[Scope, Item, list[Scope]]]:
        """All joints of the world, each with the scopes of its links."""
        for scope in self.paths:
            problems = len(self.reader.problems)
            for item in scope.items.values():
                if item.element.tag == "joint":
                    yield scope, item, self.ends(scope, item)
            if not scope.is_world:  # the error is reported when the model is read
                del self.reader.problems[problems:]

    def _held(self, read: Iterable[Scope]) -> list[Scope]:
        """The scopes that are read, and the complete models that joints connect to them."""
        found = set(read)
        between = [(scope, ends) for scope, _, ends in self._joints if len(set(ends)) == 2]
        before = 0
        while len(found) > before:
            before = len(found)
            for scope, ends in between:
                for one, other in (ends, ends[::-1]):
                    if one in found and other not in found:
                        found.update(self._whole(scope, other))
        return [scope for scope in self.paths if scope in found]

    @staticmethod
    def _whole(outer: Scope, inner: Scope) -> list[Scope]:
        """The model directly in `outer` that contains `inner`, with its nested models; only `outer` if `inner` is the
        same model."""
        if inner is outer:
            return [outer]
        while inner.parent is not None and inner.parent is not outer:
            inner = inner.parent
        return [scope for _, scope in inner.all()]

    def _only_moving(self) -> list[Scope]:
        """The models that move, if joints connect all of them; otherwise an error is reported."""
        groups: list[list[Scope]] = []
        for model in self.world.models.values():
            if not any(model in group for group in groups):
                groups.append(self._held(scope for _, scope in model.all()))
        tops = [[scope for scope in group if scope.parent is self.world] for group in groups]
        moving = [k for k, top in enumerate(tops) if not all(model.static for model in top)] or list(range(len(groups)))
        if len(moving) > 1:
            names = [tops[k][0].name for k in moving]
            shown = ", ".join(map(shortened, names[:8])) + (", ..." if len(names) > 8 else "")
            message = f"{len(names)} models move and no joint connects them: {shown}; only one can be read"
            self.reader.wrong(tops[moving[1]][0].element, f"{message}: choose it by --model {names[0]}")
            return []
        return groups[moving[0]]

    def _unknown(self, chosen: str) -> None:
        """Report that no model has the chosen name."""
        names = [path.removesuffix("::") for path in self.paths.values() if path]
        names.sort(key=lambda name: name.count("::"))  # the sort is stable, so models of the world come first
        shown = ", ".join(names[:_SHOWN]) + (", ..." if len(names) > _SHOWN else "")
        within = [name for name in names if name.endswith(f"::{chosen}")]
        hint = f"; did you mean {within[0]}?" if within else nearest(chosen, names)
        self.reader.wrong(self.reader.root, f"--model {chosen} is not a model; models are {shown}{hint}")
