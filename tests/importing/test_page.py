"""docs/import.md: its robot gives its model, and its code runs."""

import re
from pathlib import Path

import codegen
from codegen.importing.parameters import WORDS

PAGE = (Path(__file__).parents[2] / "docs" / "import.md").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


def test_the_robot_of_the_page_becomes_its_model(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("ROS_PACKAGE_PATH", raising=False)
    (robot,), (model, side), (code, _) = blocks("xml"), blocks("yaml"), blocks("python")
    Path("arm.urdf").write_text(robot)
    assert codegen.import_model("arm.urdf").text == model
    exec(compile(code, "import.md", "exec"), {})
    assert codegen.load_model("arm.yaml").inputs == ("tau_upper_arm", "tau_forearm")
    Path("side.yaml").write_text(side)
    assert len(codegen.import_model("arm.urdf", loops="side.yaml").model.loops) == 1
    (asked,) = re.findall(r"`--parameterize (upper-arm:\S+)`", PAGE)
    assert [p.name for p in codegen.import_model("arm.urdf", parameterize=asked).model.parameters] == [
        "upper_arm_length", "forearm_mass",
    ]  # fmt: skip
    Path("arm.urdf").write_text(robot.replace('<parent link="base"/>', '<parent link="bse"/>'))
    (said,) = re.findall(r"    (arm\.urdf:\d+:.*)", PAGE)
    try:
        codegen.import_model("arm.urdf")
    except codegen.ModelError as error:
        assert str(error).partition(": ")[2] == said.partition(": ")[2]


def test_the_system_of_sympy_on_the_page_becomes_a_model():
    names = {}
    exec(compile(blocks("python")[1], "import.md", "exec"), names)
    assert names["found"].model.speed_names == ("cart", "rod") and names["found"].warnings == ()


def test_every_word_and_option_is_on_the_page():
    rows = re.findall(r"^\| `(\w+)` \| `BODY", PAGE, re.MULTILINE)
    assert rows == list(WORDS)
    import argparse

    from codegen.importing.command import add_arguments

    parser = argparse.ArgumentParser()
    add_arguments(parser)
    options = [a.option_strings[-1] for a in parser._actions if a.option_strings]
    assert all(o in PAGE for o in options if o not in ("--help", "--output"))
