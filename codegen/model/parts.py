"""The files of a model: its own, those that it includes, and one for each submodel.

An included file is read as if it were written in the file that includes it. A submodel is a further use of a file: its
names have a prefix, and its ground is a frame on a body of the model that uses it. The using model may give values for
constants, parameters and inputs of the submodel. The names in entries of such files are resolved here; all other
modules read entries without knowing about files.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from .binding import Binder, Numbers, Scope, index_text
from .errors import ModelError, Problem, nearest
from .expressions import Expression, combine
from .grammar import MEASURED, ExpressionError, Number, Tree
from .positions import Document, Path_, compose, read_file
from .surfaces import COORDINATES
from .tables import Table
from .trees import mapped, parts
from .units import Dimension

MAX_PARTS: Final = 20_000
"""Largest number of uses of files in a model; this many are read within seconds."""


@dataclass(slots=True)
class Instance:
    """One entry of a section after repetition.

    Attributes
    ----------
    key : str
        As written, such as ``link(k)``.
    value : Any
        The entry's plain data; the same object for all equal repetitions.
    container : dict
        The mapping that contains `key`, for places in messages.
    section : tuple of str
        Path that messages print before the key.
    indices : dict of str to int or str
        Values of the repeat indices.
    part : Part
        The use of the file that contains the entry.
    """

    key: str
    value: Any
    container: dict[str, Any]
    section: Path_
    indices: dict[str, int | str]
    part: Part


@dataclass(eq=False)
class Given:
    """A number that a model gives to a submodel.

    Attributes
    ----------
    value : Any
        As written, with names of the file that uses the submodel.
    at : Instance
        The entry of the submodel in that file.
    key : str
        The number's key in this entry, under ``with``.
    used : bool
        Whether the submodel has such a name.
    """

    value: Any
    at: Instance
    key: str
    used: bool = False


@dataclass(eq=False)
class Part:
    """One use of a file in a model.

    Attributes
    ----------
    document : Document
    outer : Part or None
        The file that includes or uses this one; None for the model's own file.
    prefix : str
        Prefix of each name of a submodel; empty otherwise.
    frame : Instance or None
        For a submodel: the entry of the massless body that replaces its ground.
    ground : str
        The name of that body, or of the ground.
    constants : dict of str to number
        Also the labels of repetitions. An included file shares the constants of the file that includes it.
    given : dict of str to Given
        Numbers of a submodel that the model gives, by their names in the submodel.
    values : dict of str to tuple
        The trees that replace names: given numbers, and named expressions.
    tables : dict of str to Table
        Tables by their names in the file.
    used_names : set of str
        Names that have been used.
    dimensions : dict of str to Dimension
        Dimensions of constants, parameters and given numbers that are written with a unit.
    """

    document: Document
    outer: Part | None = None
    prefix: str = ""
    frame: Instance | None = None
    ground: str = "ground"
    constants: dict[str, Number | str] = field(default_factory=dict)
    given: dict[str, Given] = field(default_factory=dict)
    values: dict[str, Tree] = field(default_factory=dict)
    dimensions: dict[str, Dimension] = field(default_factory=dict)
    tables: dict[str, Table] = field(default_factory=dict)
    binder: Binder = field(init=False)
    used_names: set[str] = field(default_factory=set, init=False)
    _renamed: dict[Expression, Expression] = field(default_factory=dict, init=False)
    _written_out: dict[tuple[object, ...], Expression] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        self.binder = Binder(self.constants)

    def including(self, document: Document) -> Part:
        """The part for a file that the file of this part includes."""
        part = Part(
            document, self, self.prefix, None, self.ground, self.constants, self.given, self.values, self.dimensions
        )
        part.binder, part._renamed, part.used_names = self.binder, self._renamed, self.used_names
        return part

    def stands_for(self, name: str, tree: Tree) -> None:
        """Replace a name by a tree in all expressions that are read from now on."""
        self.values[name] = tree
        self._renamed.clear()

    def chain(self) -> list[Document]:
        """The documents from the document of this part outward to the model's own."""
        found, part = [], self  # type: list[Document], Part | None
        while part is not None:
            found.append(part.document)
            part = part.outer
        return found

    @property
    def is_submodel(self) -> bool:
        """Whether the part is a submodel, whose names have a prefix."""
        return bool(self.prefix)

    @property
    def where(self) -> str:
        """The words `` (in NAME)`` for messages about the file of a submodel."""
        return f" (in {self.prefix[:-1]})" if self.prefix else ""

    def entry(self, key: str) -> Instance:
        """A key of the file's top level, for messages about it."""
        return Instance(key, self.document.root.get(key), self.document.root, (), {}, self)

    def name(self, name: str) -> str:
        """The name in the model of a body, loop, point, force, output, parameter or input of the file."""
        return self.prefix + name

    def referred(self, name: str) -> str:
        """The body or point of the model that a name in the file refers to."""
        return self.ground if name == "ground" else self.prefix + name

    def written(self, name: str) -> str:
        """A name of the model as the file writes it."""
        first, dot, rest = name.partition(".")
        if dot and first in ("q", "u", *MEASURED):
            return f"{first}.{rest.removeprefix(self.prefix)}"
        return name.removeprefix(self.prefix)

    def own(self, names: Iterable[str]) -> list[str]:
        """The names of the model that the file can use, in the form in which the file writes them."""
        if not self.prefix:
            return [*names, *self.values]
        cut = len(self.prefix)
        return [*(n[cut:] for n in names if n.startswith(self.prefix)), *self.values]

    def bound(self, expression: Expression, indices: Mapping[str, int | str]) -> Expression:
        """The expression with constants and indices as numbers, in names of the whole model.

        Raises
        ------
        ExpressionError
            Raised by `bind`.
        """
        if self.tables:
            expression = self._with_tables(expression, indices)
        result = self.binder(expression, indices)
        if result.is_number or not (self.prefix or self.values):
            return result
        known = self._renamed.get(result)
        if known is None:
            known = self._renamed[result] = Expression(self._tree(result.tree))
        return known

    def _with_tables(self, expression: Expression, indices: Mapping[str, int | str]) -> Expression:
        """An expression in which calls of tables are replaced by formulas."""
        key = expression, tuple((i, n) for i, n in indices.items() if i in expression.names)
        found = self._written_out.get(key)
        if found is None:
            tree = self._of_tables(expression.tree, Scope(indices, self.constants))
            found = expression if tree is expression.tree else Expression(tree)
            self._written_out[key] = found
        return found

    def _of_tables(self, tree: Tree, numbers: Numbers) -> Tree:
        if tree[0] == "indexed":
            name = "" if tree[3] else self._table(tree, numbers)
            if not name:
                return tree
            self.used_names.add(name)
            return self.tables[name].at(self._of_tables(tree[2][-1], numbers))
        return mapped(tree, lambda part: self._of_tables(part, numbers))

    def _table(self, tree: Tree, numbers: Numbers) -> str:
        """The name of the table that is called, with indices before its argument; empty if there is none."""
        name: str = tree[1]
        if name in self.tables and len(tree[2]) == 1:
            return name
        repeated = [known for known in self.tables if known.startswith(f"{name}_")]
        if not repeated:
            return ""
        try:
            indices = [index_text(i, numbers) for i in tree[2]]
        except ExpressionError:
            try:
                name = "_".join([name, *(index_text(i, numbers) for i in tree[2][:-1])])
            except ExpressionError:
                return ""  # the error is reported when the expression is bound
            if name in self.tables:
                return name
            message = f"{name} is not a table; tables are {', '.join(repeated[:6])}, called {tree[1]}(k)(x) or {repeated[0]}(x)"
            raise ExpressionError(message) from None
        name = "_".join([name, *indices[:-1]])
        return name if name in self.tables else ""

    def _tree(self, tree: Tree) -> Tree:
        kind = tree[0]
        if kind == "number":
            return tree
        if kind == "name":
            return self._name(tree[1])
        return combine(tree[1] if kind == "call" else kind, *map(self._tree, parts(tree)))

    def _name(self, name: str) -> Tree:
        if name == "t" or name in COORDINATES:
            return ("name", name)
        first, dot, rest = name.partition(".")
        if dot and first in ("q", "u"):
            return ("name", f"{first}.{self.prefix + rest}")
        if dot and first in MEASURED:
            point, _, component = rest.partition(".")
            return ("name", f"{first}.{self.referred(point)}.{component}")
        self.used_names.add(name)
        return self.values.get(name, ("name", self.prefix + name))


class Files:
    """Opens each file of a model once, and no file outside the folder of the first.

    Parameters
    ----------
    document : Document
        The first file.
    folder : str or None
        Its folder; None for a text without a folder.
    """

    def __init__(self, document: Document, folder: str | None) -> None:
        self.first = document
        self.folder = None if folder is None else os.path.realpath(folder)
        self.opened: dict[str, Document] = {os.path.realpath(document.file): document}
        self.names: list[str] = []
        self.is_wanting = False  # whether a file could not be opened
        self._paths: dict[int, str] = {id(document): os.path.realpath(document.file)}

    def open(self, text: str, writer: Document, add: Callable[[Problem], None]) -> Document | str:
        """The document of a path in another document, or an error message about the path.

        Errors in the file itself are added to the problems, and its document is then empty.
        """
        if self.folder is None:
            return (
                f"file {text!r} of a model that comes from no file; "
                "load the model from a file, or give the folder of its files by folder=..."
            )
        if os.path.isabs(text) or "\\" in text or "\0" in text:
            return f"{text!r} is not a path within the model's folder; write it relative to this file: parts/leg.yaml"
        own = self._paths.get(id(writer), "")
        start = os.path.dirname(own) if writer is not self.first else self.folder
        path = os.path.realpath(os.path.join(start, text))
        if os.path.commonpath((path, self.folder)) != self.folder:
            return f"{text!r} leaves the model's folder; the files of a model must be in its folder or below it"
        found = self.opened.get(path)
        if found is None:
            if not os.path.isfile(path):
                return f"file {text!r} does not exist; {_there(path, text)}"
            shown = os.path.join(os.path.dirname(self.first.file), os.path.relpath(path, self.folder))
            try:
                found = compose(_text(path, shown), shown)
            except ModelError as error:
                found = Document(shown, {})
                found.problems.extend(error.problems)
            if not isinstance(found.root, dict):
                if not found.problems:
                    message = "a file of a model must be a mapping with sections such as bodies and parameters"
                    found.problems.append(Problem(shown, 1, 1, "", message))
                found.root = {}
            for problem in found.problems:
                add(problem)
            self.opened[path] = found
            self.names.append(shown)
            self._paths[id(found)] = path
        return found


def _text(path: str, shown: str) -> str:
    try:
        return read_file(path)
    except ModelError as error:
        raise ModelError([Problem(shown, p.line, p.column, p.path, p.message) for p in error.problems]) from None


def _there(path: str, text: str) -> str:
    """A hint that lists the files that exist instead."""
    folder = os.path.dirname(path)
    if not os.path.isdir(folder):
        return "its folder does not exist; paths are relative to the folder of the file that contains them"
    names = sorted(n for n in os.listdir(folder) if n.endswith((".yaml", ".yml")))
    if not names:
        return "its folder contains no YAML files"
    some = ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
    return f"in its folder there are {some}{nearest(os.path.basename(text), names)}"
