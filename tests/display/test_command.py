"""``ordernm view``: the requests that it refuses before the work, and the files that it writes."""

from pathlib import Path

import pytest

from codegen import cli

MODEL = """
model: swing
gravity: [0, 0, -9.81]
parameters: {length: 1.0}
bodies:
  rod:
    parent: ground
    joint: {type: revolute, axis: y}
    shape: {type: rod, axis: z, length: length, mass: 1, center: [0, 0, -length/2]}
initial: {q: {rod: 0.5}}
"""


@pytest.fixture(autouse=True)
def model(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    Path("swing.yaml").write_text(MODEL)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("-p weight=1 --picture a.png", "-p weight: the model has no such parameter; its parameters: length"),
        ("--picture a.jpg", "--picture a.jpg: a name that ends in .svg or .png or .pdf is needed"),
        ("-t 0 --animate a.gif", "-t is 0; more than 0 s"),
        ("-t 1e9 --animate a.gif", "less than"),
        ("--port 0", "--port is 0; 1 to 65535 are allowed"),
        ("--picture swing.yaml.png", "exists, and ordernm did not write it"),
    ],
)
def test_what_cannot_be_shown_is_refused(capsys, arguments, message):
    pytest.importorskip("viser")
    Path("swing.yaml.png").write_text("mine")
    assert cli.main(["view", "swing.yaml", *arguments.split()]) == 2
    assert message in capsys.readouterr().err
    assert Path("swing.yaml.png").read_text() == "mine"


def test_pictures_animations_and_pages_are_written_and_replaced(capsys):
    pytest.importorskip("viser")
    for _ in range(2):  # the second time they are known as ordernm's
        assert cli.main("view swing.yaml -t 0.2 --picture a.svg --animate a.gif --html a.html".split()) == 0
        assert capsys.readouterr().out.splitlines()[-3:] == ["wrote a.svg", "wrote a.gif", "wrote a.html"]
    assert Path("a.html").stat().st_size > 100_000
    assert cli.main("view swing.yaml --html state.html".split()) == 0
    assert cli.main("simulate swing.yaml -t 0.2 -o run.npz".split()) == 0
    assert cli.main("view swing.yaml --trajectory run.npz --html a.html".split()) == 0


def test_warnings_of_a_model_are_those_of_other_commands(capsys):
    pytest.importorskip("viser")
    Path("swing.yaml").write_text(MODEL.replace("{length: 1.0}", "{length: 1.0, unused: 2.0}"))
    assert cli.main(["check", "swing.yaml"]) == 0
    warning = capsys.readouterr().out.splitlines()[0]
    assert "warning: " in warning and "unused" in warning
    assert cli.main("view swing.yaml --picture a.svg".split()) == 0
    assert capsys.readouterr().err.splitlines() == [warning]


def test_what_does_not_fit_the_model_is_one_line(capsys):
    pytest.importorskip("viser")
    Path("other.yaml").write_text(MODEL.replace("swing", "other").replace("rod:", "bar:").replace("q: {rod", "q: {bar"))
    assert cli.main("simulate swing.yaml -t 0.2 -o run.npz".split()) == 0
    assert cli.main("generate swing.yaml --target numpy".split()) == 0
    capsys.readouterr()
    for command, message in (
        ("view other.yaml --trajectory run.npz --picture a.png", "the trajectory is of model swing"),
        ("view other.yaml --trajectory run.npz --html a.html", "the trajectory is of model swing"),
        ("view generated/swing --picture a.png", "generate it with --frames"),
    ):
        assert cli.main(command.split()) == 2
        error = capsys.readouterr().err
        assert message in error and error.count("\n") == 1
    assert not Path("a.png").exists() and not Path("a.html").exists()
