"""Functions of solvers as differentiable operators of PyTorch (extra ``torch``)."""

from typing import TYPE_CHECKING

from ..deferred import deferred

if TYPE_CHECKING:
    from .functions import function as function
    from .motions import judge as judge
    from .motions import simulate as simulate

__all__ = ["function", "judge", "simulate"]

__getattr__ = deferred(__name__, {"function": "functions", "judge": "motions", "simulate": "motions"})
