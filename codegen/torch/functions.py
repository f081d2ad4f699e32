"""`function`: a function of a solver as a differentiable operator of PyTorch."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..operators import Operator, bound, checked_batch, given_entry, operator, wrong_type

MOST_SHAPES = 1000
"""Number of combinations of shapes that a function remembers as right."""


def function(solver: Any, name: str) -> Callable[..., Any]:
    """Return a function of a solver as a differentiable operator of PyTorch.

    It has exact first and second derivatives by autograd and `torch.func`, and stays one operator under
    `torch.compile`. Batches go to the solver's compiled code as a whole.

    Parameters
    ----------
    solver : Solver
        The solver. Later changes of its partition and of `bad_states` have no effect.
    name : str
        The method of the solver: ``accelerations``, ``coordinate_rates``, ``outputs``, ``energies``,
        ``inverse_dynamics``, ``driving_forces``, ``mass_matrix`` or ``solve_mass``.

    Returns
    -------
    callable
        ``f(q, u, p=None, inputs=None, t=0.0)``, or the arguments of the solver's method of this name. Leading axes are
        batch axes and broadcast. ``energies`` returns (..., 2): kinetic and potential energy.

    Raises
    ------
    ImportError
        If PyTorch is not installed.
    TypeError
        If the first argument is not a solver. A call raises it for a wrong type or number of arguments.
    ValueError
        If no function of this name can be differentiated. A call raises it for wrong shapes and names; it also raises
        the errors of the solver's method.
    AttributeError
        If the package was generated without the function.
    NotImplementedError
        Raised by a second derivative that the package does not have, and by a third derivative.

    Examples
    --------
    >>> import torch
    >>> import ordernm.torch
    >>> names = ["accelerations", "sensitivities", "gradients"]
    >>> report = ordernm.generate("examples/pendulum.yaml", "turned", functions=names)
    >>> turned = ordernm.load("turned")
    >>> accelerations = ordernm.torch.function(turned, "accelerations")
    >>> p = torch.tensor(turned.parameters, requires_grad=True)
    >>> accelerations([0.5], [0.0], p).sum().backward()
    >>> bool((p.grad == torch.tensor(turned.gradients([0.5], [0.0], weights=[1.0]).p[0])).all())
    True
    """
    try:
        import torch  # noqa: F401
    except ImportError:
        raise ImportError("ordernm.torch needs PyTorch: pip install 'ordernm[torch]'") from None
    return _of(operator(solver, name))


def _of(of: Operator) -> Callable[..., Any]:
    """The function of an operator."""
    import torch

    from .operators import called, computed, defaults_of, direct, key_of

    key, names, defaults = key_of(of), of.six, defaults_of(of)
    kind = getattr(torch, str(of.dtype))
    nothing = torch.zeros(0, dtype=kind)
    seen: set[Any] = set()
    short: set[Any] = set()
    position = {n: i for i, n in enumerate(of.takes)}  # solve_mass takes no u
    places = [(position.get(n, len(names)), 0.0 if n == "t" else None) for n in names if n]

    def call(*arguments: Any, **named: Any) -> Any:
        arrays = None if named else direct(of, arguments)
        if arrays is not None:
            given_shapes = tuple([a.shape for a in arrays])
            if given_shapes in short:
                last = len(arrays)
                return computed(of, tuple([arrays[i] if i < last else default for i, default in places]))
        given = bound(of, arguments, named)
        x = {n: tensor(of, n, a, defaults[n], kind) for n, a in given.items()}
        shapes = () if torch.compiler.is_compiling() else tuple([a.shape for a in x.values()])
        if shapes not in seen:  # a check takes longer than a look into this set
            checked_batch(of, {n: tuple(a.shape) for n, a in x.items()})
            if shapes and len(seen) < MOST_SHAPES:
                seen.add(shapes)
        if arrays is not None and len(short) < MOST_SHAPES and all(0 not in (s or (0,)) for s in given_shapes):
            short.add(given_shapes)
        return called(*[x.get(n, nothing) for n in names], key)

    call.__name__ = call.__qualname__ = of.name
    call.operator = of  # type: ignore[attr-defined]  # keeps it as long as the function
    return call


def tensor(of: Operator, name: str, x: Any, default: Any, kind: Any) -> Any:
    """An argument as a tensor of the package's type."""
    import torch

    if type(x) is torch.Tensor and x.dtype is kind and x.is_cpu:
        return x
    if x is None:
        return default
    if type(x) is float:
        return torch.tensor(x, dtype=kind) if x or name != "t" else default
    if isinstance(x, Mapping):
        entries = {
            of.index(name, entry): tensor(of, name, given_entry(of, name, entry, y), default, kind)
            for entry, y in x.items()
        }
        batch = torch.broadcast_shapes(*(e.shape for e in entries.values()))
        columns = [entries[i] if i in entries else default[i] for i in range(default.shape[-1])]
        return torch.stack([c.expand(batch) for c in columns], -1)
    if isinstance(x, (list, tuple)) and any(isinstance(e, torch.Tensor) for e in x):
        return torch.stack([tensor(of, name, e, default, kind) for e in x])
    if not isinstance(x, torch.Tensor):
        try:  # a copy, since the caller may change an array before derivatives read it
            given = torch.from_numpy(np.array(x, order="C"))
        except (TypeError, ValueError, RuntimeError) as error:
            raise TypeError(f"{of.name}: {name} is {x!r}, expected numbers: {error}") from None
        number = isinstance(x, (int, float, list, tuple))
        x = given.to(kind) if number else given
    if x.device.type != "cpu":
        raise ValueError(
            f"{of.name}: {name} is on device {x.device}, and solvers compute on the CPU: call {name}.cpu()"
        )
    if x.dtype != kind:
        if not x.dtype.is_floating_point and not x.dtype.is_complex:
            return x.to(kind)
        raise wrong_type(of, name, str(x.dtype).removeprefix("torch."), tuple(x.shape))
    return x
