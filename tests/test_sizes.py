"""A function has at most 60 lines, a file at most 500: what is longer says why, or is on a list that only gets shorter.

A reason is a comment ``# long: ...`` within the function, or at the beginning of a line of the file. `LONG_CODE` lists what was
longer when the rule came. Nothing is added to it; what is no longer long is taken out by ``ORDERNM_UPDATE_GOLDEN=1``.
"""

import ast
import os
import re
from functools import cache
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "codegen"
LONG_CODE = Path(__file__).with_name("long_code.txt")
FUNCTION, FILE = 60, 500
REASON = re.compile(r"^(\s*)# long: \S", re.MULTILINE)


def long_parts(source: str) -> list[str]:
    """The long parts of a file without a stated reason: functions by name, and "" for the file."""
    lines = source.splitlines()
    found = []
    if len(lines) > FILE and not any(not m[1] for m in REASON.finditer(source)):
        found.append("")

    def walk(node: ast.AST, within: str) -> None:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.expr):  # no function is defined within one
                continue
            name = within
            if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
                name = f"{within}.{child.name}".lstrip(".")
                own = lines[child.lineno - 1 : child.end_lineno]
                is_long = not isinstance(child, ast.ClassDef) and len(own) > FUNCTION
                if is_long and not REASON.search("\n".join(own)):
                    found.append(name)
            walk(child, name)

    walk(ast.parse(source), "")
    return found


@cache
def everything_long() -> set[str]:
    return {
        f"{path.relative_to(PACKAGE).as_posix()} {part}".strip()
        for path in sorted(PACKAGE.rglob("*.py"))
        for part in long_parts(path.read_text(encoding="utf-8"))
    }


def test_nothing_new_is_long():
    found, listed = everything_long(), set(LONG_CODE.read_text(encoding="utf-8").splitlines())
    if os.environ.get("ORDERNM_UPDATE_GOLDEN"):
        LONG_CODE.write_text("".join(f"{x}\n" for x in sorted(found & listed)), encoding="utf-8")
    new = sorted(found - listed)
    assert not new, (
        f"over {FUNCTION} lines of a function or {FILE} of a file; divide by job, or write '# long: why': {new}"
    )


def test_the_list_names_nothing_that_is_short():
    gone = sorted(set(LONG_CODE.read_text(encoding="utf-8").splitlines()) - everything_long())
    assert not gone, f"no longer long; ORDERNM_UPDATE_GOLDEN=1 python -m pytest tests/test_sizes.py takes out: {gone}"


def test_long_functions_and_files_are_seen_and_reasons_count():
    body = "    x = 1\n" * 60
    assert long_parts(f"def f():\n{body}") == ["f"]
    assert long_parts(f"class A:\n    def f(self):\n{body.replace('    ', '        ')}") == ["A.f"]
    assert long_parts(f"def f():\n    # long: a table\n{body}") == []
    assert long_parts("x = 1\n" * 501) == [""]
    assert long_parts("# long: a table\n" + "x = 1\n" * 501) == []
    assert long_parts("def f():\n" + "    x = 1\n" * 59 + "y = 2\n") == []
