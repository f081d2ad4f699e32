"""Operation counts of statements: additions (and subtractions), multiplications, divisions, functions."""

from __future__ import annotations

from ..records import dataclass
from . import algebra
from .algebra import Expr, Function, Pow
from .block import Block


@dataclass(frozen=True, slots=True)
class Operations:
    """Operation counts; they can be added with + and multiplied with *."""

    additions: int = 0
    multiplications: int = 0
    divisions: int = 0
    functions: int = 0

    @property
    def flops(self) -> int:
        """The number of additions, multiplications and divisions."""
        return self.additions + self.multiplications + self.divisions

    def words(self) -> str:
        """The non-zero counts as text: ``3 additions, 1 division``."""
        counts = {name: getattr(self, name) for name in ("additions", "multiplications", "divisions", "functions")}
        return ", ".join(f"{n} {name[:-1] if n == 1 else name}" for name, n in counts.items() if n)

    def __add__(self, other: Operations) -> Operations:
        return Operations(
            self.additions + other.additions,
            self.multiplications + other.multiplications,
            self.divisions + other.divisions,
            self.functions + other.functions,
        )

    def __mul__(self, n: int) -> Operations:
        return Operations(self.additions * n, self.multiplications * n, self.divisions * n, self.functions * n)


@algebra.remembered
def count_expression(e: Expr) -> Operations:
    """Operations of one right side as it is printed. Changes of sign are not counted."""
    if e.is_Symbol or e.is_Number:
        return Operations()
    additions = multiplications = divisions = functions = 0
    if e.is_Add:
        additions = len(e.args) - 1
    elif e.is_Mul:
        factors = [a for a in e.args if a is not algebra.MINUS_ONE]
        below = [a for a in factors if isinstance(a, Pow) and isinstance(a.exp.value, int) and a.exp < 0]
        if below:
            multiplications = max(0, len(factors) - len(below) - 1) + len(below) - 1
            divisions = 1 - len(below)  # the recursion counts one division for each power in `below`
        else:
            multiplications = len(factors) - 1
    elif isinstance(e, Pow):
        if isinstance(e.exp.value, int):
            n = abs(int(e.exp))
            multiplications = bin(n).count("1") + n.bit_length() - 2
            divisions = int(bool(e.exp < 0))
        else:
            functions = 1
    elif isinstance(e, Function):
        is_product = e.name in ("Vanishing", "Along")
        multiplications, functions = int(is_product), int(not is_product)
    found = Operations(additions, multiplications, divisions, functions)
    for a in e.args:
        if not (a.is_Symbol or a.is_Number):
            found = found + count_expression(a)
    return found


def count(block: Block) -> tuple[Operations, Operations]:
    """Operations of a block: once per call, and once per direction.

    Stores count like statements, and a store that adds counts as an addition. The test of a margin is a comparison, which counts
    as a subtraction.
    """
    found = [0, 0, 0, 0], [0, 0, 0, 0]
    values = [(s.lanes, s.expression) for s in block.statements]
    for store, _, e in block.stores:
        found[store.lanes][0] += store.adds
        values.append((store.lanes, e))
    for lanes, e in values:
        if not (e.is_Symbol or e.is_Number):
            of, counts = count_expression(e), found[lanes]
            counts[0] += of.additions
            counts[1] += of.multiplications
            counts[2] += of.divisions
            counts[3] += of.functions
    once, each = found
    return Operations(*once), Operations(*each)
