"""Files of other people: no command replaces or deletes one without ``--force``; every command replaces its own files."""

import json
import os
import threading
from pathlib import Path

import numpy as np
import pytest

from codegen import own_files
from codegen.bench import plots
from codegen.bench.results import read_results, write_results
from codegen.cli import main
from codegen.folders import FolderError
from codegen.reporting import gallery, pages
from codegen.reporting.agreement import NoReportError, read
from codegen.runtime.standalone.files.whole_file import MARK, write_whole

MODEL = """\
model: swing
gravity: [0, 0, -9.81]
bodies:
  rod:
    parent: ground
    joint: {type: revolute, axis: y}
    shape: {type: cylinder, axis: z, length: 1.0, radius: 0.02, density: 2700, center: [0, 0, -0.5]}
initial: {q: {rod: 0.5}}
outputs: {energy: kinetic_energy}
"""


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("swing.yaml").write_text(MODEL)
    return tmp_path


def contents():
    return {str(p): p.read_bytes() for p in sorted(Path().rglob("*")) if p.is_file()}


def run(*arguments):
    return main([str(a) for a in arguments])


def results(folder):
    """A small benchmark result in a file that the command has written."""
    file = folder / "earlier.json"
    machine = dict.fromkeys(
        ("processor", "instructions", "compiler", "flags", "system", "python", "numpy", "ordernm"), "x"
    )
    write_results({"format": 1, "machine": machine, "quick": True, "problems": {}}, file)
    return file


@pytest.fixture
def foreign(here):
    """A user's files under the names that commands write."""
    Path("report/figures").mkdir(parents=True)
    for name in ("report.md", "index.html", "figures/times.svg", "figures/mine.svg"):
        Path("report", name).write_text("mine")
    Path("report/report.json").write_text('{"model": "mine", "generated": 1}')
    np.savez("data.npz", a=np.arange(3))
    for name in ("notes.json", "page.md", "picture.svg", "picture.png", "picture.pdf"):
        Path(name).write_text("mine")
    Path("pictures").mkdir()
    Path("pictures/roofline.svg").write_text("<svg/>")
    Path("package").mkdir()
    Path("package/README.md").write_text("mine")
    results(here)
    return here


COMMANDS = [
    "report swing.yaml",
    "report swing.yaml -o report",
    "simulate swing.yaml -t 0.1 -o data.npz",
    "simulate swing.yaml -t 0.1 --plot picture.svg",
    "simulate swing.yaml -t 0.1 --plot picture.png",
    "simulate swing.yaml -t 0.1 --plot picture.pdf",
    "bench --results earlier.json -o swing.yaml",
    "bench --results earlier.json -o notes.json",
    "bench --results earlier.json --page page.md",
    "bench --results earlier.json --plots pictures",
    "bench --results earlier.json --plots page.md",
    "generate swing.yaml -o package",
    "new swing.yaml",
]


@pytest.mark.parametrize("command", COMMANDS)
def test_files_of_others_stay(foreign, capsys, command):
    before = contents()
    assert run(*command.split()) == 2
    assert contents() == before
    err = capsys.readouterr().err
    assert len(err.splitlines()) == 1 and ("--force" in err or "is a file; give a folder" in err)


def test_own_files_are_replaced_and_others_on_request(here, capsys):
    pytest.importorskip("matplotlib", reason="plots need matplotlib")
    earlier = results(here)
    commands = [
        "simulate swing.yaml -t 0.1 --samples 3 -o run.npz --plot run.svg",
        "simulate swing.yaml -t 0.1 --samples 3 --plot run.png",
        "simulate swing.yaml -t 0.1 --samples 3 --plot run.pdf",
        f"bench --results {earlier} -o again.json --page page.md",
    ]
    written = ("run.npz", "run.svg", "run.png", "run.pdf", "again.json", "page.md")
    for _ in range(2):
        assert [run(*c.split()) for c in commands] == [0] * len(commands)
    for name in written:
        assert own_files.is_own(Path(name)), name
        Path(name).write_text("mine")
    assert [run(*c.split()) for c in commands] == [2] * len(commands)
    assert {Path(name).read_text() for name in written} == {"mine"}
    assert [run(*c.split(), "--force") for c in commands] == [0] * len(commands)
    assert all(own_files.is_own(Path(name)) for name in written)


def test_force_in_a_folder_leaves_what_has_other_names(here, capsys):
    package = Path("package")
    (package / "data").mkdir(parents=True)
    (package / "data" / "x.csv").write_text("1,2")
    (package / "README.md").write_text("mine")
    (package / "link").symlink_to("data")
    assert run("generate", "swing.yaml", "-o", package, "--no-compile") == 2
    assert (package / "README.md").read_text() == "mine"
    for _ in range(2):  # what was left makes it a folder with something else again
        assert run("generate", "swing.yaml", "-o", package, "--no-compile", "--force") == 0
        assert (package / "data" / "x.csv").read_text() == "1,2" and (package / "link").is_symlink()
        assert "Forward dynamics" in (package / "README.md").read_text() and (package / "swing.c").is_file()
        assert run("generate", "swing.yaml", "-o", package, "--no-compile") == 2


def written_report(folder, force=False):
    made = {"index.html": "<html>", "report.md": "# text", "figures/times.svg": "<svg>"}
    own = {name: pages.file_digest(text.encode()) for name, text in made.items()}
    made["report.json"] = json.dumps({"written": MARK, "files": own})
    pages.write_folder(folder, made, pages.refuse_foreign(folder, force))


def test_a_report_knows_its_files_by_their_contents(here):
    folder = Path("report")
    for _ in range(2):
        written_report(folder)
    (folder / "report.md").write_text("with a remark of mine")
    with pytest.raises(FolderError, match=r"no report wrote: report\.md \(changed since\)\. .*--force"):
        pages.refuse_foreign(folder)
    written_report(folder, force=True)
    (folder / "figures" / "mine.svg").write_text("mine")
    with pytest.raises(FolderError, match=r"figures/mine\.svg"):
        pages.refuse_foreign(folder)
    written_report(folder, force=True)
    assert (folder / "figures" / "mine.svg").read_text() == "mine"
    for text in (
        "",
        "[",
        "3",
        "[" * 100000,
        '{"files": {}}',
        '{"written": 3, "files": 3}',
        f'{{"written": "{MARK}", "files": 3}}',
    ):
        (folder / "report.json").write_text(text)
        with pytest.raises(FolderError, match=r"index\.html"):
            pages.refuse_foreign(folder)


def test_a_gallery_goes_on_after_a_bad_model(here, monkeypatch, capsys):
    pytest.importorskip("matplotlib", reason="reports draw figures")
    Path("models").mkdir()
    for name in ("a", "b", "c"):
        Path(f"models/{name}.yaml").write_text(MODEL if name != "a" else "model: [")
    Path("models/b.yaml").write_text(MODEL.replace("type: revolute", "type: revolt"))
    done = []

    def report(file, folder, **options):
        from codegen import load_model

        load_model(file)
        done.append(file.stem)
        written_report(folder, options["force"])
        return {"generated": dict.fromkeys(("bodies", "loops", "freedoms"), 1), "skipped": []}

    monkeypatch.setattr(gallery, "report", report)
    for _ in range(2):
        assert run("report", "models", "-o", "all") == 1
    err = capsys.readouterr().err
    assert done == ["c", "c"] and "report: a: models/a.yaml" in err and "report: b: models/b.yaml" in err
    page = Path("all/index.html").read_text()
    assert "No report of a" in page and "No report of b" in page and 'href="c/index.html"' in page
    Path("all/index.html").write_text("mine")
    assert run("report", "models", "-o", "all") == 2 and Path("all/index.html").read_text() == "mine"
    Path("all/index.html").unlink()
    Path("all/c/report.md").write_text("mine")
    assert run("report", "models", "-o", "all") == 2 and done == ["c", "c"]


def test_a_comparison_with_another_model_is_refused_before_the_work(here, capsys):
    Path("old").mkdir()
    text = {"model": "other", "generated": {}, "skipped": [], "machine": {}}
    Path("old/report.json").write_text(json.dumps(text))
    assert run("report", "swing.yaml", "--compare", "old") == 2
    assert "is damaged, or of another version" in capsys.readouterr().err
    text |= {"machine": dict.fromkeys(("processor", "instructions", "compiler", "flags"), "x")}
    Path("old/report.json").write_text(json.dumps(text))
    assert run("report", "swing.yaml", "--compare", "old") == 2
    assert "the reports are of different models, other and swing" in capsys.readouterr().err
    Path("old/report.json").write_text(json.dumps(text | {"model": "swing"}))
    assert run("report", "swing.yaml", "--compare", "old") == 2
    assert "the reports are from different machines: processor: x, " in capsys.readouterr().err
    assert not Path("report").exists()


@pytest.mark.parametrize("text", ["[" * 100000, "{", "3", '{"model": 1, "generated": 2}', "\udcff", "9" * 9999])
def test_damaged_files_to_compare_with(here, text, capsys):
    Path("old.json").write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(NoReportError, match=r"old\.json"):
        read(Path("old.json"))
    assert run("bench", "--results", "old.json") == 2
    assert "old.json" in capsys.readouterr().err


def test_results_are_looked_through_before_they_are_used(here, capsys):
    good = json.loads(results(here).read_text())
    for name in ("machine", "quick", "problems"):
        Path("old.json").write_text(json.dumps({n: x for n, x in good.items() if n != name}))
        assert run("bench", "--results", "old.json") == 2
    row = {"size": 1, "seconds": {"udot": "long"}, "error": None}
    good["problems"] = {"x": {"kind": "family", "sizes": [row]}}
    Path("old.json").write_text(json.dumps(good))
    assert run("bench", "--results", "old.json") == 2
    assert "does not contain benchmark results" in capsys.readouterr().err
    assert read_results(results(here))["quick"]


def test_what_is_no_regular_file_is_written_to(here):
    """As root, a file that takes the place of a device would be the end of it."""
    os.mkfifo("pipe")
    found = []
    reader = threading.Thread(target=lambda: found.append(Path("pipe").read_bytes()))
    reader.start()
    write_whole(Path("pipe"), lambda file: file.write(b"text"))
    reader.join(10)
    assert found == [b"text"] and not Path("pipe").is_file() and own_files.is_own(Path("pipe"))


def test_what_appears_during_the_work_stays_too(here, monkeypatch, capsys):
    """A file that was put there while a motion was computed."""
    monkeypatch.setattr("codegen.simulating.more_choices", lambda *_: Path("run.npz").write_text("mine") and None)
    assert run("simulate", "swing.yaml", "-t", 0.1, "-o", "run.npz") == 2
    assert Path("run.npz").read_text() == "mine"
    assert "run.npz exists, and ordernm did not write it" in capsys.readouterr().err


def test_pictures_have_the_names_that_are_looked_at(monkeypatch):
    monkeypatch.setattr(plots, "time_by_size", lambda *_: "")
    monkeypatch.setattr(plots, "roofline", lambda *_: "")
    monkeypatch.setattr(plots, "robots", lambda *_: "")
    family = {"kind": "family", "sizes": [{"roofline": 1}, {}]}
    found = plots.plots({"peaks": {}, "problems": {"f": family, "r": {"kind": "robots", "rows": [1]}}})
    assert set(found) == set(plots.PICTURES)


def test_files_with_the_former_mark_are_own_files(tmp_path):
    file = tmp_path / "page.html"
    file.write_text("<!-- ordernm wrote this file, and replaces it when told to write it again -->")
    assert own_files.is_own(file)
