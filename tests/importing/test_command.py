"""`ordernm import`: its files, its output, and its exit codes."""

import subprocess
import sys
from pathlib import Path

import pytest
from imported_robots import ARM, joint, link, robot

from codegen.cli import main


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("arm.urdf").write_text(ARM)
    return tmp_path


def test_a_model_file_is_written_and_what_is_left_out_listed(here, capsys):
    assert main(["import", "arm.urdf", "-o", "model.yaml"]) == 0
    out, err = capsys.readouterr()
    assert not err
    assert out.splitlines() == [
        "wrote model.yaml: 2 bodies, 2 speeds; now: generate model.yaml",
        "  left out: <limit> (line 40): limits of position, speed and force; no effect within limits and without contact",
    ]
    assert sorted(p.name for p in here.iterdir()) == ["arm.urdf", "model.yaml"]
    assert main(["check", "model.yaml"]) == 0
    before = Path("model.yaml").read_bytes()
    assert main(["import", "arm.urdf", "-o", "model.yaml"]) == 0  # the same: nothing to lose
    assert Path("model.yaml").read_bytes() == before
    assert main(["import", "arm.urdf"]) == 0 and Path("two_link_arm.yaml").read_bytes() == before


def test_another_file_is_replaced_on_request_only(here, capsys):
    Path("model.yaml").write_text("mine")
    assert main(["import", "arm.urdf", "-o", "model.yaml"]) == 2
    assert (
        capsys.readouterr().err
        == "import: model.yaml exists and differs; choose another file with -o, or use --force\n"
    )
    assert Path("model.yaml").read_text() == "mine"
    assert main(["import", "arm.urdf", "-o", "model.yaml", "--force"]) == 0
    assert Path("model.yaml").read_text().startswith("# arm.urdf, imported by ordernm.")


def test_it_is_printed_on_request(here, capsys):
    assert main(["import", "arm.urdf", "-o", "-", "--name", "mine", "--base", "free", "--motors"]) == 0
    out, err = capsys.readouterr()
    assert "\nmodel: mine\n" in out and "joint: {type: free}" in out and "inputs: [tau_upper_arm, tau_forearm]" in out
    assert err.startswith("left out: ")
    assert not list(here.glob("*.yaml"))


def test_what_is_wrong_is_told_and_nothing_is_written(here, capsys):
    Path("bad.urdf").write_text(robot(link("base"), link("a", -1), joint("j", "base", "a", "hinge")))
    assert main(["import", "bad.urdf", "-o", "model.yaml"]) == 1
    out, err = capsys.readouterr()
    assert not out and err.splitlines() == [
        "bad.urdf:3:26: the mass is -1; at least 0 kg is needed",
        "bad.urdf:4:1: joint 'j' is 'hinge'; revolute, continuous, prismatic, fixed, floating, planar are joints",
    ]
    assert main(["import", "arm.urdf", "--name", "2 b"]) == 1
    assert "--name: '2 b' cannot name a model" in capsys.readouterr().err
    assert main(["import", "arm.urdf", "-o", "no/such/folder/model.yaml"]) == 2
    assert "import: no/such/folder: no such folder; make it first" in capsys.readouterr().err
    assert main(["import", "arm.urdf", "--parameterize", "forearm:weight"]) == 1
    assert "'weight' is not a number of a body" in capsys.readouterr().err
    assert not list(here.rglob("*.yaml")) and not list(here.glob(".*"))


def test_warnings_go_to_stderr(here, capsys):
    Path("odd.urdf").write_text(robot(link("base"), link("a", 1, (1, 1, 3)), joint("j", "base", "a")))
    assert main(["import", "odd.urdf"]) == 0
    assert "odd.urdf:3:1: warning: the inertia of link 'a'" in capsys.readouterr().err
    assert main(["import", "odd.urdf", "--repair", "--force"]) == 0
    assert "; repaired" in capsys.readouterr().err


@pytest.mark.parametrize(("package", "text"), [("mujoco", "<mujoco/>")])
def test_a_missing_package_is_told(here, package, text):
    Path("robot.xml").write_text(text)
    hide = f"import sys; sys.modules[{package!r}] = None; from codegen.cli import main; sys.exit(main(['import', 'robot.xml']))"
    ended = subprocess.run([sys.executable, "-c", hide], capture_output=True, text=True, check=False)
    assert ended.returncode == 2 and "pip install mujoco" in ended.stderr and "Traceback" not in ended.stderr


def test_neither_mujoco_nor_pinocchio_is_imported_for_a_urdf(here):
    code = (
        "import sys, codegen; codegen.import_model('arm.urdf'); "
        "sys.exit(bool({'mujoco', 'pinocchio'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize(("program", "arguments"), [("main", ["import", "arm.urdf"]), ("generate_main", ["arm.yaml"])])
def test_an_interrupt_while_modules_are_imported_is_a_message(here, program, arguments):
    """Ctrl-C before a command runs, while Python imports what its options need."""
    stop = "import sys, codegen.cli; from codegen.deferred import deferred\n"
    stop += "class Stop:\n    def find_spec(self, name, *rest):\n"
    stop += "        if name.startswith('codegen.'): raise KeyboardInterrupt\n"
    stop += f"sys.meta_path.insert(0, Stop()); sys.exit(codegen.cli.{program}({arguments}))"
    ended = subprocess.run([sys.executable, "-c", stop], capture_output=True, text=True, check=False)
    assert ended.returncode == 130 and "interrupted" in ended.stderr and "Traceback" not in ended.stderr
