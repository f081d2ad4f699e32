"""`judge` and `simulate`: functionals, states and outputs of a motion as functions for PyTorch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from ..differentiable_motions import DifferentiableMotion, JudgedMotion, Moved, SimulatedMotion


def judge(solver: Any, t: Any, functionals: Any, *, wrt: str | Sequence[str], **options: Any) -> Callable[..., Any]:
    """Return functionals of a motion as a function of its variables for PyTorch, with exact first derivatives.

    If x requires gradients, the motion runs with sensitivities or the discrete adjoint, whichever is cheaper.
    `torch.func.vmap` runs one motion after another.

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
    >>> import torch
    >>> import ordernm.torch
    >>> from ordernm.runtime import Final
    >>> report = ordernm.generate("examples/double_pendulum.yaml", "thrown")
    >>> tip = ordernm.torch.judge(ordernm.load("thrown"), 1.0, [Final("tip_x")], wrt=["length_1", "q0.upper"])
    >>> x = torch.ones(2, dtype=torch.float64, requires_grad=True)
    >>> tip(x).sum().backward()
    >>> x.grad.shape
    torch.Size([2])
    """
    # long: the docstring describes every argument
    return _called(JudgedMotion(solver, t, functionals, wrt, options), lambda found: found[0])


def simulate(solver: Any, t: Any, *, wrt: str | Sequence[str], **options: Any) -> Callable[..., Any]:
    """Return a motion as a function of its variables for PyTorch: states and outputs at given times, with exact derivatives.

    Derivatives use the motion's sensitivities; gradients use the discrete adjoint if that is cheaper.
    `torch.func.vmap` runs one motion after another.

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
    >>> import torch
    >>> import ordernm.torch
    >>> report = ordernm.generate("examples/double_pendulum.yaml", "seen")
    >>> run = ordernm.torch.simulate(ordernm.load("seen"), [0.0, 0.5, 1.0], wrt=["length_1", "q0.upper"])
    >>> x = torch.tensor([1.0, 0.5], dtype=torch.float64, requires_grad=True)
    >>> run(x).q[-1].sum().backward()
    >>> x.grad.shape
    torch.Size([2])
    """
    # long: the docstring describes every argument
    return _called(SimulatedMotion(solver, t, wrt, options), lambda found: Moved(*found))


def _called(motion: DifferentiableMotion, shaped: Callable[[Any], Any]) -> Callable[..., Any]:
    """The function of a motion."""
    try:
        import torch
    except ImportError:
        raise ImportError("ordernm.torch needs PyTorch: pip install 'ordernm[torch]'") from None
    from .motion_functions import Value

    @torch.compiler.disable  # compiled programs call it as it is
    def call(x: Any) -> Any:
        x = x if isinstance(x, torch.Tensor) else torch.tensor(x, dtype=torch.float64)
        motion.check(tuple(x.shape), str(x.dtype).removeprefix("torch."))
        if x.device.type != "cpu":
            raise ValueError(f"{motion.member}: x is on device {x.device}, and motions run on the CPU: call x.cpu()")
        return shaped(Value.apply(x, motion))

    call.__name__ = call.__qualname__ = motion.member
    return call
