"""`judge` and `simulate`: functionals, states and outputs of a motion as functions for JAX."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from ..differentiable_motions import DifferentiableMotion, JudgedMotion, Moved, SimulatedMotion


def judge(solver: Any, t: Any, functionals: Any, *, wrt: str | Sequence[str], **options: Any) -> Callable[..., Any]:
    """Return functionals of a motion as a function of its variables for JAX, with exact first derivatives.

    The motion runs outside of XLA, by `Solver.judge`, and derivatives use sensitivities or the discrete adjoint,
    whichever is cheaper. `jax.vmap` runs one motion after another.

    Parameters
    ----------
    solver : Solver
        The solver.
    t : float or tuple of two float
        End of the motion, s, or its start and end.
    functionals : functional or sequence of functionals
        As in `Solver.judge`.
    wrt : str or sequence of str
        Names of the k variables: parameters, ``q0.NAME`` and ``u0.NAME`` for initial values, ``inputs.NAME`` for all
        values of an input, ``inputs.NAME[i]`` for one. The name of a vector stands for its entries.
    **options : dict
        Further arguments of `Solver.judge`, such as `q`, `inputs` or `rtol`; what `wrt` does not name is constant.

    Returns
    -------
    callable
        ``f(x)``: values (m,) of the functionals at the variables x (k,), float64.

    Raises
    ------
    TypeError
        If the solver has no motions. A call raises it for another type of x.
    ValueError
        If `wrt` names no variable. A call raises it for another shape of x.

    Examples
    --------
    >>> import jax
    >>> import ordernm.jax
    >>> from ordernm.runtime import Final
    >>> jax.config.update("jax_enable_x64", True)
    >>> report = ordernm.generate("examples/double_pendulum.yaml", "swung")
    >>> tip = ordernm.jax.judge(ordernm.load("swung"), 1.0, [Final("tip_x")], wrt=["length_1", "q0.upper"])
    >>> jax.jacobian(tip)(jax.numpy.array([1.0, 1.0])).shape
    (1, 2)
    """
    # long: the docstring describes every argument
    return _called(JudgedMotion(solver, t, functionals, wrt, options), lambda found: found[0])


def simulate(solver: Any, t: Any, *, wrt: str | Sequence[str], **options: Any) -> Callable[..., Any]:
    """Return a motion as a function of its variables for JAX: states and outputs at given times, with exact derivatives.

    The motion runs outside of XLA, by `Solver.simulate`. Derivatives use its sensitivities; gradients use the
    discrete adjoint if that is cheaper. `jax.vmap` runs one motion after another.

    Parameters
    ----------
    solver : Solver
        The solver.
    t : array_like (nt,)
        Increasing times, s; the motion begins at the first.
    wrt : str or sequence of str
        Names of the k variables: parameters, ``q0.NAME`` and ``u0.NAME`` for initial values, ``inputs.NAME`` for all
        values of an input, ``inputs.NAME[i]`` for one. The name of a vector stands for its entries.
    **options : dict
        Further arguments of `Solver.simulate`, such as `q`, `inputs` or `rtol`; what `wrt` does not name is constant.

    Returns
    -------
    callable
        ``f(x)``: a named tuple of q (nt, nq), u (nt, nu) and outputs (nt, noutputs) at the variables x (k,), float64.

    Raises
    ------
    TypeError
        If the solver has no motions. A call raises it for another type of x.
    ValueError
        If `wrt` names no variable, or t is no array of times. A call raises it for another shape of x.

    Examples
    --------
    >>> import jax
    >>> import ordernm.jax
    >>> jax.config.update("jax_enable_x64", True)
    >>> report = ordernm.generate("examples/double_pendulum.yaml", "shown")
    >>> run = ordernm.jax.simulate(ordernm.load("shown"), [0.0, 0.5, 1.0], wrt=["length_1", "q0.upper"])
    >>> jax.jacobian(run)(jax.numpy.array([1.0, 0.5])).q.shape
    (3, 2, 2)
    """
    # long: the docstring describes every argument
    return _called(SimulatedMotion(solver, t, wrt, options), lambda found: Moved(*found))


def _called(motion: DifferentiableMotion, shaped: Callable[[Any], Any]) -> Callable[..., Any]:
    """The function of a motion."""
    try:
        import jax
        import jax.numpy as jnp
    except ImportError:
        raise ImportError("ordernm.jax needs JAX: pip install 'ordernm[jax]'") from None
    from .motion_primitives import bind

    def call(x: Any) -> Any:
        x = jnp.asarray(x) if isinstance(x, jax.Array) else jnp.array(x)
        motion.check(x.shape, str(x.dtype))
        return shaped(bind("value", x, motion=motion))

    call.__name__ = call.__qualname__ = motion.member
    return call
