"""The examples of the documentation have the results that it states."""

import re
from pathlib import Path

import pytest

from codegen.model import ModelBuilder, ModelError, parse_model

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "model_format.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)


@pytest.mark.parametrize("text", EXAMPLES, ids=[t.split()[1] for t in EXAMPLES])
def test_examples_load_without_warnings(text):
    assert parse_model(text, folder=ROOT / "examples").warnings == ()


def test_there_are_examples_and_the_four_legs_stand_apart():
    models = {m.name: m for m in (parse_model(text, folder=ROOT / "examples") for text in EXAMPLES)}
    assert set(models) == {
        "arm", "chain", "four_bar", "cam", "walker", "quadruped", "hopper", "shaken", "winch", "geared_arm", "forearm",
    }  # fmt: skip
    assert models["chain"].nu == 100
    hips = [b for b in models["walker"].bodies if b.name.startswith("hip")]
    assert {tuple(e.value for e in b.joint.at[:2]) for b in hips} == {(x, y) for x in (0.4, -0.4) for y in (0.2, -0.2)}
    assert len({id(b.mass) for b in hips}) == 1


def test_the_python_examples():
    for code, nu in zip(re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL), (10, 1), strict=True):
        names: dict = {}
        exec(compile(code, "model_format.md", "exec"), names)
        assert names["model"].nu == nu
        assert isinstance(names["b"], ModelBuilder)


def test_the_quoted_message():
    (line,) = re.findall(r"^    (arm\.yaml:.*)$", PAGE, re.MULTILINE)
    with pytest.raises(ModelError) as info:
        parse_model(EXAMPLES[0].replace("    mass:", "    mas:"), "arm.yaml")
    assert line in str(info.value).splitlines()


def test_the_quadruped_is_that_of_the_examples():
    (text,) = (t for t in EXAMPLES if t.startswith("model: quadruped"))
    written = (ROOT / "examples" / "quadruped.yaml").read_text(encoding="utf-8")
    assert written.partition("\n")[2] == text and len(text.splitlines()) < 25


def test_the_units_are_those_there_are():
    from codegen.model.units import UNITS

    table = PAGE.partition("| | units |")[2].partition("Units are joined")[0]
    assert set(re.findall(r"`(\w+)`", table)) == set(UNITS)
