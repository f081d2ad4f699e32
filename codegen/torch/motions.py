"""`judge`: functionals of a motion as a function for PyTorch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from ..judged_motions import JudgedMotion


def judge(solver: Any, t: Any, functionals: Any, *, wrt: str | Sequence[str], **options: Any) -> Callable[..., Any]:
    """Return functionals of a motion as a function of parameters for PyTorch, with exact first derivatives.

    If x requires gradients, the motion runs with sensitivities or the discrete adjoint, whichever is cheaper.

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
    >>> import torch
    >>> import ordernm.torch
    >>> from ordernm.runtime import Final
    >>> report = ordernm.generate("examples/double_pendulum.yaml", "thrown")
    >>> tip = ordernm.torch.judge(ordernm.load("thrown"), 1.0, [Final("tip_x")], wrt=["length_1", "mass_2"])
    >>> x = torch.ones(2, dtype=torch.float64, requires_grad=True)
    >>> tip(x).sum().backward()
    >>> x.grad.shape
    torch.Size([2])
    """
    # long: the docstring describes every argument
    try:
        import torch
        from torch.autograd.function import once_differentiable
    except ImportError:
        raise ImportError("ordernm.torch needs PyTorch: pip install 'ordernm[torch]'") from None
    motion = JudgedMotion(solver, t, functionals, wrt, options)

    class Judge(torch.autograd.Function):
        @staticmethod
        def forward(ctx: Any, x: Any) -> Any:
            numbers = x.detach().numpy()
            if not ctx.needs_input_grad[0]:
                return torch.tensor(motion.values(numbers))
            values, gradients = motion.both(numbers)
            ctx.save_for_backward(torch.tensor(gradients))
            return torch.tensor(values)

        @staticmethod
        @once_differentiable
        def backward(ctx: Any, weights: Any) -> Any:
            return weights @ ctx.saved_tensors[0]

    def call(x: Any) -> Any:
        motion.check(tuple(x.shape), str(x.dtype).removeprefix("torch."))
        return Judge.apply(x)

    return call
