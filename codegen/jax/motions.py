"""`judge`: functionals of a motion as a function for JAX."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from ..judged_motions import JudgedMotion


def judge(solver: Any, t: Any, functionals: Any, *, wrt: str | Sequence[str], **options: Any) -> Callable[..., Any]:
    """Return functionals of a motion as a function of parameters for JAX, with exact first derivatives.

    The motion runs outside of XLA, by `Solver.judge`. A derivative runs it once more, with sensitivities or the discrete
    adjoint, whichever is cheaper. `jax.vmap` runs one motion after another.

    Parameters
    ----------
    solver : Solver
        The solver.
    t : float or tuple of two float
        End of the motion, s, or its start and end.
    functionals : functional or sequence of functionals
        As in `Solver.judge`.
    wrt : str or sequence of str
        Names of the k parameters.
    **options : dict
        Further arguments of `Solver.judge`, such as `q`, `inputs` or `rtol`; they are constants.

    Returns
    -------
    callable
        ``f(x)``: values (m,) of the functionals at the parameters x (k,), float64.

    Raises
    ------
    TypeError
        If the solver has no motions. A call raises it for another type of x.
    ValueError
        If `wrt` names no parameter. A call raises it for another shape of x.

    Examples
    --------
    >>> import jax
    >>> import ordernm.jax
    >>> from ordernm.runtime import Final
    >>> jax.config.update("jax_enable_x64", True)
    >>> report = ordernm.generate("examples/double_pendulum.yaml", "swung")
    >>> tip = ordernm.jax.judge(ordernm.load("swung"), 1.0, [Final("tip_x")], wrt=["length_1", "mass_2"])
    >>> jax.jacobian(tip)(jax.numpy.array([1.0, 1.0])).shape
    (1, 2)
    """
    # long: the docstring describes every argument
    try:
        import jax
        import jax.numpy as jnp
    except ImportError:
        raise ImportError("ordernm.jax needs JAX: pip install 'ordernm[jax]'") from None
    motion = JudgedMotion(solver, t, functionals, wrt, options)
    values, both = _callbacks(jax, motion)

    def call(x: Any) -> Any:
        x = jnp.asarray(x)
        motion.check(x.shape, str(x.dtype))
        return values(x)

    @values.defjvp
    def _(primals: Any, tangents: Any) -> Any:
        found, slopes = both(*primals)
        return found, slopes @ tangents[0]

    return call


def _callbacks(jax: Any, motion: JudgedMotion) -> tuple[Any, Any]:
    """Values, and values with gradients, computed outside of XLA."""
    m = jax.ShapeDtypeStruct((motion.count,), "float64")
    matrix = jax.ShapeDtypeStruct((motion.count, len(motion.names)), "float64")

    @jax.custom_jvp
    def values(x: Any) -> Any:
        return jax.pure_callback(motion.values, m, x, vmap_method="sequential")

    @jax.custom_jvp
    def both(x: Any) -> Any:
        return jax.pure_callback(motion.both, (m, matrix), x, vmap_method="sequential")

    @both.defjvp
    def _(primals: Any, tangents: Any) -> Any:
        raise NotImplementedError(motion.no_second())

    return values, both
