"""Data classes that take little time to define.

The standard `dataclasses.dataclass` compiles up to six functions for each class, which took half of the generator's
import time. The decorator of this module compiles only ``__init__``; the functions for comparison, hash and repr are
shared by all classes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dataclasses import dataclass as dataclass
else:
    from dataclasses import dataclass as _standard
    from dataclasses import fields
    from functools import partial
    from operator import attrgetter
    from reprlib import recursive_repr

    def dataclass(cls=None, /, *, eq=True, frozen=False, **options):
        """Like `dataclasses.dataclass`, with two differences.

        Attributes of a `frozen` class can be assigned at run time, although type checkers report the assignment; the
        class is hashable all the same. The option `order` does not exist.
        """
        if cls is None:
            return partial(dataclass, eq=eq, frozen=frozen, **options)
        made = _standard(cls, eq=False, repr=False, **options)
        own = vars(cls)
        found = {"__repr__": _shown, **(_comparing(made, frozen) if eq else {})}
        for name, function in found.items():
            if own.get(name) is None:  # in a class with __eq__, Python sets __hash__ to None
                setattr(made, name, function)
        return made

    @recursive_repr()
    def _shown(self):
        values = (f"{f.name}={getattr(self, f.name)!r}" for f in fields(self) if f.repr)
        return f"{type(self).__qualname__}({', '.join(values)})"

    def _comparing(made, frozen):
        """The methods ``__eq__``, which compares tuples of all values, and ``__hash__``, for frozen classes."""
        names = [f.name for f in fields(made) if f.compare]
        values = attrgetter(*names) if names else lambda self: ()

        def equal(self, other):
            return values(self) == values(other) if other.__class__ is self.__class__ else NotImplemented

        return {"__eq__": equal, "__hash__": (lambda self: hash(values(self))) if frozen else None}


__all__ = ["dataclass"]
