"""What can be wrong with closed loops, said with names: of the loop, of the joint, and the rank that was found."""


class AssemblyError(ValueError):
    """Loops that cannot be closed by moving what may move; the text names the loop and by how much it stays open."""


class PartitionError(ValueError):
    """Coordinates that cannot be divided as asked: a hint that cannot be independent, or no freedom left."""
