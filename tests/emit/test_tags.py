"""Every tag in generated code, such as ``Eq. 46`` or ``rank``, is explained: in a docstring, or in the page of the theory."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from codegen.model import load_model
from codegen.pipeline import write_solver

ROOT = Path(__file__).parents[2]
EQUATIONS = re.compile(r"\bEqs?\. (\d+(?:(?:-|, | and )\d+)*)")


def equations(text):
    """Numbers of the equations that a text names, including ranges: ``Eqs. 18-20, 31``."""
    found = set()
    for group in EQUATIONS.findall(text):
        for part in re.split(", | and ", group):
            first, _, last = part.partition("-")
            found |= set(range(int(first), int(last or first) + 1))
    return found


@pytest.fixture(scope="module")
def explained():
    """The texts that explain tags: the docstrings of the generator, and the theory page."""
    texts = [(ROOT / "docs" / "theory.md").read_text()]
    for file in (ROOT / "codegen").rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)):
                texts.append(ast.get_docstring(node) or "")
            elif (
                isinstance(node, ast.Expr)
                and isinstance(node.value, ast.Constant)
                and isinstance(node.value.value, str)
            ):
                texts.append(node.value.value)  # below an attribute
    return "\n".join(texts)


def tags(source):
    """The tags in comments after statements, and in parentheses in the heads of functions."""
    text = "\n".join(t for n, t in source.files.items() if n.endswith((".c", "_directions.h")) and "_calls" not in n)
    behind = set(re.findall(r"^    +const (?:double|VECTOR) .*; /\* (.+) \*/$", text, re.M))
    heads = {f"Eq. {n}" for head in re.findall(r"^/\* .*\((Eqs?\. .*?)\)", text, re.M) for n in equations(head)}
    return {tag.removeprefix("T ").removeprefix("d ") for tag in behind} | heads


@pytest.mark.parametrize("name", ["andrews", "four_bar", "satellite"])
def test_tags_are_explained(name, explained):
    known = equations(explained)
    found = tags(write_solver(load_model(ROOT / "examples" / f"{name}.yaml")))
    assert {"Eq. 47", "primitive"} <= found
    for tag in sorted(found):
        numbers = equations(tag)
        assert numbers <= known if numbers else tag in explained, f"{tag!r} is explained nowhere"
