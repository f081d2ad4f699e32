"""What can be wrong with closed loops, said with names: of the loop, of the joint, and the rank that was found."""

from collections.abc import Sequence


class AssemblyError(ValueError):
    """Loops that cannot be closed by moving what may move; the text names the loop and by how much it stays open.

    Attributes
    ----------
    loop : str
        Name of the loop that is furthest from closure.
    residual : float
        Its largest scaled residual.
    """

    def __init__(self, message: str, loop: str = "", residual: float = float("nan")) -> None:
        super().__init__(message)
        self.loop = loop
        self.residual = residual


class PartitionError(ValueError):
    """Coordinates that cannot be divided as asked: a hint that cannot be independent, or no freedom left.

    Attributes
    ----------
    loops : tuple of str
        The loops that do not close because of that, where it is a hint.
    names : tuple of str
        The speeds that are asked to be independent and cannot be, or not all of them; empty where it is no hint.
    """

    def __init__(self, message: str, loops: Sequence[str] = (), names: Sequence[str] = ()) -> None:
        super().__init__(message)
        self.loops = tuple(loops)
        self.names = tuple(names)
