"""What can be wrong with closed loops, said with names: of the loop, of the joint, and the rank that was found."""


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
    """Coordinates that cannot be divided as asked: a hint that cannot be independent, or no freedom left."""
