"""`function`: a function of a solver as a pure function for JAX."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..operators import Operator, bound, checked_batch, given_entry, operator, wrong_type


def function(solver: Any, name: str) -> Callable[..., Any]:
    """Return a function of a solver as a pure function for JAX, with exact derivatives.

    It runs the solver's compiled code within XLA, under `jax.jit`, `jax.vmap`, `jax.jvp`, `jax.vjp` and combinations of
    these. Batches are computed several states at once, on XLA's threads.

    Parameters
    ----------
    solver : Solver
        A solver with compiled code. Later changes of its partition and of `bad_states` have no effect.
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
        If JAX is not installed.
    TypeError
        If the first argument is not a solver. A call raises it for a wrong type or number of arguments.
    ValueError
        If no function of this name can be differentiated. A call raises it for wrong shapes and names.
    AttributeError
        If the package was generated without the function.
    NotImplementedError
        Raised by a second derivative that the package does not have, and by a third derivative.

    Examples
    --------
    >>> import jax
    >>> import ordernm.jax
    >>> jax.config.update("jax_enable_x64", True)
    >>> names = ["accelerations", "sensitivities", "gradients"]
    >>> report = ordernm.generate("examples/pendulum.yaml", "swing", functions=names)
    >>> swing = ordernm.load("swing")
    >>> accelerations = ordernm.jax.function(swing, "accelerations")
    >>> bool(accelerations([0.5], [0.0]) == swing.accelerations([0.5], [0.0]))
    True
    >>> jax.jacobian(accelerations, argnums=2)([0.5], [0.0], swing.parameters).shape == (1, swing.np)
    True
    """
    of = _operator(solver, name)

    def call(*arguments: Any, **named: Any) -> Any:
        return _called(of, arguments, named)

    call.__name__ = call.__qualname__ = name
    return call


def _operator(solver: Any, name: str) -> Operator:
    """The operator of a function that JAX can call."""
    try:
        import jax  # noqa: F401
    except ImportError:
        raise ImportError("ordernm.jax needs JAX: pip install 'ordernm[jax]'") from None
    of = operator(solver, name)
    if of.composed:
        raise NotImplementedError(
            f"{name} of {of.solver.name}: in mechanisms with closed loops this method runs in Python, and JAX needs compiled "
            "code; use ordernm.torch.function"
        )
    return of


def _called(of: Operator, arguments: tuple[Any, ...], named: Mapping[str, Any]) -> Any:
    from .primitives import value

    given = bound(of, arguments, named)
    arrays = {n: _array(of, n, x) for n, x in given.items()}
    batch = checked_batch(of, {n: a.shape for n, a in arrays.items()})
    operands = [_laid(of, n, arrays[n], batch) for n in of.names]
    found = value(of, operands)
    return found.reshape(*batch, *of.shape)


def _array(of: Operator, name: str, x: Any) -> Any:
    """An argument as an array of the package's type."""
    import jax
    import jax.numpy as jnp

    if of.dtype == np.float64 and not jax.config.jax_enable_x64:
        raise TypeError(
            f"{of.name} of {of.solver.name} computes in float64, and JAX is limited to float32; call "
            "jax.config.update('jax_enable_x64', True) first, or generate the package with scalar='float32'"
        )
    if x is None:
        return jnp.asarray(of.defaults[name], of.dtype)
    if isinstance(x, Mapping):
        entries = {of.index(name, entry): _array(of, name, given_entry(of, name, entry, y)) for entry, y in x.items()}
        batch = jnp.broadcast_shapes(*(y.shape for y in entries.values()))
        columns = [jnp.broadcast_to(entries.get(i, y), batch) for i, y in enumerate(of.defaults[name].tolist())]
        return jnp.stack(columns, -1).astype(of.dtype)
    given = getattr(x, "dtype", None)
    weak = getattr(x, "weak_type", False) or (given is not None and jnp.issubdtype(given, jnp.integer))
    if given is not None and given != of.dtype and not weak:
        raise wrong_type(of, name, str(given), tuple(x.shape))
    try:  # a copy of other arrays, since the caller may change one before derivatives read it
        return jnp.asarray(x, of.dtype) if isinstance(x, jax.Array) else jnp.array(x, of.dtype)
    except (TypeError, ValueError) as error:
        if isinstance(x, jax.Array):
            raise
        raise TypeError(f"{of.name}: {name} is {x!r}, expected numbers: {error}") from None


def _laid(of: Operator, name: str, x: Any, batch: tuple[int, ...]) -> Any:
    """An argument as primitives take it: (n,) if all states share it, else (*batch, n)."""
    import jax.numpy as jnp

    x = x[..., None] if name == "t" else x
    return x if x.ndim == 1 else jnp.broadcast_to(x, (*batch, x.shape[-1]))
