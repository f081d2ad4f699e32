"""The text of a parsed expression."""

from __future__ import annotations

from .grammar import AT_LEAST, CHOICE, VANISHING, WRAPPED, Tree

PRECEDENCE = {"+": 1, "-": 1, "*": 2, "/": 2, "%": 2, "neg": 3, "**": 4}


def print_tree(tree: Tree, around: int) -> str:
    """Text of a tree, in parentheses if its operator binds more weakly than `around`."""
    kind = tree[0]
    if kind == "number":
        text = repr(tree[1])
        return f"({text})" if text.startswith("-") and around > 1 else text
    if kind == "name":
        return str(tree[1])
    if kind == "call" and tree[1] == AT_LEAST:
        return f"({print_tree(tree[2], 0)} >= {print_tree(tree[3], 0)})"
    if kind == "call" and tree[1] == CHOICE:
        return f"if({_condition(tree[2])}, {print_tree(tree[3], 0)}, {print_tree(tree[4], 0)})"
    if kind == "call" and tree[1] == VANISHING:
        return print_tree(("*", *tree[2:]), around)
    if kind == "call" and tree[1] == WRAPPED:
        return print_tree(("call", "mod", *tree[2:]), around)
    if kind == "call":
        return f"{tree[1]}({', '.join(print_tree(a, 0) for a in tree[2:])})"
    if kind == "indexed":
        return str(tree[1]) + "".join(f"({print_tree(i, 0)})" for i in tree[2]) + str(tree[3])
    if kind == "quantity":
        return str(tree[3])
    if kind == "component":
        return print_tree(tree[1], around)
    own = PRECEDENCE[kind]
    if kind == "neg":
        text = "-" + print_tree(tree[1], own)
    elif kind == "**":
        text = f"{print_tree(tree[1], own + 1)}**{print_tree(tree[2], own)}"
    else:
        space = " " if own == 1 else ""
        text = f"{print_tree(tree[1], own)}{space}{kind}{space}{print_tree(tree[2], own + 1)}"
    return f"({text})" if own < around else text


def _condition(tree: Tree) -> str:
    """Text of a condition, which is a tree of comparisons with the value 1 if it holds and 0 otherwise."""
    match tree:
        case ("call", "at_least", a, b):
            return f"{print_tree(a, 0)} >= {print_tree(b, 0)}"
        case ("-", ("number", 1), ("call", "at_least", a, b)):
            return f"{print_tree(a, 0)} < {print_tree(b, 0)}"
        case ("*", a, b):
            return f"({_condition(a)} and {_condition(b)})"
        case ("call", "max", a, b):
            return f"({_condition(a)} or {_condition(b)})"
    return print_tree(tree, 0)
