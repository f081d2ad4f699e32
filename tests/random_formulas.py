"""Random formulas in the grammar of model files, with all its functions."""

from __future__ import annotations

import numpy as np

from codegen.elementary import TABLE

NAMES = ("a", "b", "c")
_POSITIVE = {"log": "1.5 + {}**2", "sqrt": "0.3 + {}**2", "acosh": "1.2 + {}**2"}
_BOUNDED = ("asin", "acos", "atanh")


def random_formula(rng: np.random.Generator, depth: int = 4) -> str:
    """The text of a formula whose functions mostly have arguments in their domains."""
    if depth == 0 or rng.random() < 0.12:
        return str(rng.choice([*NAMES, "pi", "2", "0.75", "1/3", "5"]))
    one, other = (random_formula(rng, depth - 1) for _ in range(2))
    kind = rng.integers(9)
    if kind < 4:
        return f"({one} {rng.choice(['+', '-', '*'])} {other})"
    if kind == 4:
        return f"({one})/(1.2 + ({other})**2)"
    if kind == 5:
        return str(rng.choice([f"({one})**2", f"({one})**3", f"(1.1 + ({one})**2)**(-2)"]))
    if kind == 6:
        sign = rng.choice(["<", "<=", ">", ">="])
        more = rng.choice(["", f" and {one} > -1", f" or not {other} < 1"])
        return f"if({one} {sign} {other}{more}, {one}, 2*{other})" if "if" not in one + other else one
    name = str(rng.choice(list(TABLE)))
    if name == "mod":
        return f"mod({one}, 1.7)"
    if name in ("exp", "sinh", "cosh"):
        return f"{name}(tanh({one}))"
    if TABLE[name].arity == 2:
        return f"{name}({one}, {other})"
    if name in _BOUNDED:
        return f"{name}(0.9*sin({one}))"
    return f"{name}({_POSITIVE.get(name, '{}').format(f'({one})')})"
