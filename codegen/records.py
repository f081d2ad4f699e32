"""Data classes that take little time to define.

The standard `dataclasses.dataclass` compiles up to six functions for each class, which is half of what importing the generator
took. This one compiles ``__init__`` alone; comparing, hashing and showing are the same functions for all classes.
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
        """What `dataclasses.dataclass` makes of a class, with two differences.

        Of a `frozen` one no attribute may be set, which type checkers see and nothing stops at run time. It is hashable all the
        same. There is no order.
        """
        if cls is None:
            return partial(dataclass, eq=eq, frozen=frozen, **options)
        made = _standard(cls, eq=False, repr=False, **options)
        own = vars(cls)
        found = {"__repr__": _shown, **(_comparing(made, frozen) if eq else {})}
        for name, function in found.items():
            if own.get(name) is None:  # of a class that compares, Python sets the hash to None
                setattr(made, name, function)
        return made

    @recursive_repr()
    def _shown(self):
        values = (f"{f.name}={getattr(self, f.name)!r}" for f in fields(self) if f.repr)
        return f"{type(self).__qualname__}({', '.join(values)})"

    def _comparing(made, frozen):
        """How instances are compared, by their values in a tuple, and hashed where they do not change."""
        names = [f.name for f in fields(made) if f.compare]
        values = attrgetter(*names) if names else lambda self: ()

        def equal(self, other):
            return values(self) == values(other) if other.__class__ is self.__class__ else NotImplemented

        return {"__eq__": equal, "__hash__": (lambda self: hash(values(self))) if frozen else None}


__all__ = ["dataclass"]
