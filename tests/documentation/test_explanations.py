"""Messages of commands refer to sections of docs/errors.md that exist and explain the error."""

import ast
import re
from functools import cache

import pytest
from doc_pages import ROOT

from codegen import cli
from codegen.explanations import ANCHORS, PAGE, explanation
from codegen.loops.errors import AssemblyError
from codegen.runtime.standalone import errors
from codegen.symbolic.errors import TooLargeError

ERRORS = {
    AssemblyError("loop"), TooLargeError("terms"), errors.AssemblyError("loop", 1.0), errors.SingularLoopError("loop"),
    errors.SingularForceError("spring", "ends coincide"), errors.SingularOutputError("gap"), errors.SingularJointError("arm"),
    errors.SimulationError("ends", None), errors.EquilibriumError(1.0, "cart", None), errors.NoCompilerError("none"),
    errors.CompileError("log"), errors.FlagsError("flags"), errors.TargetsDifferError("numbers"),
}  # fmt: skip


def sections() -> dict[str, str]:
    """The text of each section, by its anchor."""
    parts = re.split(r"^#{2,3} (.+)$", (ROOT / PAGE).read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {title.lower().replace(" ", "-"): text for title, text in zip(parts[1::2], parts[2::2], strict=True)}


def test_every_anchor_is_a_section_that_names_the_error():
    found = sections()
    assert [name for name, anchor in ANCHORS.items() if f"`{name}`" not in found.get(anchor, "")] == []


@cache
def written() -> tuple[str, ...]:
    """All texts in ordernm's source except docstrings, with "..." for formatted values."""
    found = []
    for path in sorted((ROOT / "codegen").rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
        for node in ast.walk(tree):
            if id(node) in docstrings:
                continue
            if isinstance(node, ast.JoinedStr):
                found.append("".join(p.value if isinstance(p, ast.Constant) else "..." for p in node.values))
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                found.append(node.value)
    return tuple(found)


def quoted() -> list[str]:
    """Messages that pages quote: in quotation marks, and in the table of reasons why motions end."""
    page = re.sub(r"^```.*?^```$", "", (ROOT / PAGE).read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    found = re.findall(r'"([^"]+)"', re.sub(r"`[^`]*`", "", page))
    rows = re.findall(r"^\| (.+?) \|", page.partition("| the message says |")[2].partition("###")[0], re.MULTILINE)
    found += [part for row in rows[1:] for part in row.split("; ")]
    close = (ROOT / "docs" / "howto" / "loops.md").read_text(encoding="utf-8").partition("## When it does not work")[2]
    return [" ".join(text.split()) for text in (*found, *re.findall(r'\*\*"([^"]+)"\*\*', close))]


@pytest.mark.parametrize("message", quoted())
def test_quoted_messages_are_in_the_source(message):
    """The fixed words of a quoted message follow one another in one text; "..." stands for anything."""
    wanted = re.compile(".*".join(re.escape(part.strip()) for part in message.split("...")), re.DOTALL)
    assert any(wanted.search(text) for text in written())


def test_many_messages_are_quoted():
    assert len(quoted()) > 30 and "... was generated without ..." in quoted()


@pytest.mark.parametrize("error", sorted(ERRORS, key=repr), ids=lambda e: type(e).__name__)
def test_every_error_has_the_section_of_its_class(error):
    name = next(kind.__name__ for kind in type(error).__mro__ if kind.__name__ in ANCHORS)
    assert (
        explanation(error) == f"See {PAGE}#{ANCHORS[name]}" and f"`{type(error).__name__}`" in sections()[ANCHORS[name]]
    )


def test_other_errors_have_none():
    assert explanation(ValueError("wrong")) == "" and explanation(errors.PackageError("damaged")) == ""


def test_commands_print_the_address(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    model = (
        (ROOT / "docs" / "tutorial.md")
        .read_text(encoding="utf-8")
        .partition("model: crank_rocker")[2]
        .partition("```")[0]
    )
    (tmp_path / "far.yaml").write_text("model: crank_rocker" + model.replace("base: 1.1", "base: 5.0"))
    assert cli.main(["check", "far.yaml"]) == 1
    assert capsys.readouterr().err.splitlines()[-1] == "See docs/errors.md#a-loop-cannot-be-closed"
    (tmp_path / "wrong.yaml").write_text("model: wrong\nloops: 3\nbodies: {a: {parent: ground, joint: {type: free}}}\n")
    assert cli.main(["check", "wrong.yaml"]) == 1
    assert "See " not in capsys.readouterr().err
    (tmp_path / "light.yaml").write_text("model: crank_rocker" + re.sub(r",\s+shape: {.*?}}", "}", model))
    assert cli.main(["generate", "light.yaml", "--no-check"]) == 1
    said = capsys.readouterr().err
    assert "nothing that moves with a" in said and said.splitlines()[-1] == "See docs/errors.md#a-joint-has-no-inertia"
    monkeypatch.setenv("CC", "no-such-compiler")
    (tmp_path / "near.yaml").write_text("model: crank_rocker" + model)
    assert cli.main(["generate", "near.yaml", "--compile-all", "--no-check"]) == 3
    assert capsys.readouterr().err.splitlines()[-1] == "See docs/errors.md#no-compiler"
