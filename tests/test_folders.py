"""The folder of a package: replaced in one step, restored after a kill at any moment, unchanged while in use."""

import fcntl
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

import codegen
from codegen import folders
from codegen.folders import FolderError, exchange, put_right, refuse_foreign, write_folder

ROOT = Path(codegen.__file__).parents[1]


def package(version: int) -> dict[str, str]:
    """Files that `refuse_foreign` accepts as a package."""
    files = {f"{name}.c": f"/* {version} */\n" for name in ("part_0", "part_1", "_runtime/room/part_2")}
    manifest = {"generator": "ordernm", "name": "part", "files": [*files, "model.json"], "version": version}
    return files | {"model.json": json.dumps(manifest)}


def held(folder: Path) -> dict[str, str] | None:
    if not folder.is_dir():
        return None
    return {p.relative_to(folder).as_posix(): p.read_text() for p in folder.rglob("*") if p.is_file()}


def beside(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.parent.iterdir() if p != folder)


KILLED = """
import os, shutil, signal, sys
from pathlib import Path
from codegen import folders
sys.path.insert(0, sys.argv[3])
from test_folders import package

folder, can_exchange = Path(sys.argv[1]), sys.argv[2] == "exchange"
count, last = 0, 0

def spot():
    global count
    count += 1
    if count == last:
        os.kill(os.getpid(), signal.SIGKILL)

def killing(function):
    def wrapped(*arguments, **options):
        spot()
        result = function(*arguments, **options)
        spot()
        return result
    return wrapped

os.rename, os.rmdir, os.unlink = killing(os.rename), killing(os.rmdir), killing(os.unlink)
Path.mkdir, Path.write_bytes = killing(Path.mkdir), killing(Path.write_bytes)
shutil.rmtree = killing(shutil.rmtree)
folders.exchange = killing(folders.exchange if can_exchange else lambda one, other: False)

while True:  # a process for every spot, until one comes through
    last += 1
    if (child := os.fork()) == 0:
        folders.write_folder(folder, package(last))
        os._exit(0)
    _, status = os.waitpid(child, 0)
    if not os.WIFSIGNALED(status):
        print(last, "end", flush=True)
        break
    print(last, flush=True)
    sys.stdin.readline()  # until the state has been looked at
"""


@pytest.mark.parametrize("way", ["exchange", "moves"])
@pytest.mark.parametrize("old", [True, False])
def test_a_kill_at_any_moment_leaves_a_whole_package(tmp_path, way, old):
    if way == "exchange" and folders._exchange_call() is None:
        pytest.skip("this system cannot exchange two folders")
    folder = tmp_path / "place" / "part"
    folder.parent.mkdir()
    if old:
        write_folder(folder, package(0))
    before = held(folder)
    command = [sys.executable, "-c", KILLED, folder, way, Path(__file__).parent]
    left, missing = 0, 0
    with subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdin is not None and process.stdout is not None
        for line in process.stdout:
            spot = int(line.split()[0])
            assert held(folder) in (before, package(spot), None)
            missing += old and held(folder) is None
            left += bool(beside(folder))
            put_right(folder)  # as the next run begins
            assert beside(folder) == []
            assert held(folder) in (before, package(spot)), f"killed at spot {spot}"
            before = held(folder)
            if "end" in line:
                break
            process.stdin.write("\n")
            process.stdin.flush()
    assert process.returncode == 0 and held(folder) == package(spot)
    assert spot > 10 and left > 5  # there was something to put right
    assert missing == 0 if way == "exchange" else missing >= old  # with the exchange there is a package at any time


def test_the_next_run_begins_with_putting_right(tmp_path):
    model = codegen.parse_model(
        "model: rod\nbodies:\n  a: {parent: ground, joint: {type: prismatic, axis: x}, mass: 1}\n"
    )
    folder = codegen.generate(model, tmp_path / "rod", "numpy", compile=False).folder
    whole = held(folder)
    folder.rename(tmp_path / ".rod-old-1-abcd")
    (tmp_path / ".rod-new-1-abcd").mkdir()
    for mine in (".rod-new-notes", ".rodeo-new-1-abcd", "rod-new-1-abcd"):
        (tmp_path / mine).mkdir()
    with pytest.raises(ValueError):
        codegen.generate(model, tmp_path / "rod", "rust")
    assert not folder.exists()
    assert not codegen.generate(model, folder, "numpy", compile=False).written  # it was there again
    assert held(folder) == whole and beside(folder) == [".rod-new-notes", ".rodeo-new-1-abcd", "rod-new-1-abcd"]


def test_folders_of_living_processes_stay(tmp_path):
    busy = tmp_path / ".part-new-1-abcd"
    busy.mkdir()
    handle = os.open(busy, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        put_right(tmp_path / "part")
        assert busy.is_dir()
    finally:
        os.close(handle)
    put_right(tmp_path / "part")
    assert not busy.exists()


WRITER = """
import sys, time
from pathlib import Path
sys.path.insert(0, sys.argv[3])
from test_folders import package
from codegen.folders import put_right, write_folder
end = time.monotonic() + 1.5
while time.monotonic() < end:
    put_right(Path(sys.argv[1]))
    write_folder(Path(sys.argv[1]), package(int(sys.argv[2])))
"""


def test_many_writers_at_once(tmp_path):
    """There is a whole package at any time, and nothing is left."""
    folder = tmp_path / "part"
    write_folder(folder, package(0))
    writers = [
        subprocess.Popen([sys.executable, "-c", WRITER, folder, str(k), Path(__file__).parent], cwd=ROOT)
        for k in (1, 2, 3)
    ]
    looks = 0
    while any(w.poll() is None for w in writers):
        handle = os.open(folder, os.O_RDONLY)  # never missing
        os.close(handle)
        looks += 1
        time.sleep(0.001)
    assert [w.returncode for w in writers] == [0, 0, 0] and looks > 20
    assert held(folder) in [package(k) for k in (0, 1, 2, 3)] and beside(folder) == []


def test_exchange(tmp_path):
    if folders._exchange_call() is None:
        pytest.skip("this system cannot exchange two folders")
    for name in "ab":
        (tmp_path / name).mkdir()
        (tmp_path / name / "who").write_text(name)
    assert exchange(tmp_path / "a", tmp_path / "b")
    assert (tmp_path / "a" / "who").read_text() == "b" and (tmp_path / "b" / "who").read_text() == "a"
    with pytest.raises(FileNotFoundError):
        exchange(tmp_path / "a", tmp_path / "nowhere")


def test_what_cannot_be_written_is_told_before_the_work(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(FolderError, match=r"x: .*file is a file; .*-o"):
        refuse_foreign(tmp_path / "file" / "x")
    (tmp_path / "round").symlink_to(tmp_path / "round")
    put_right(tmp_path / "round")
    with pytest.raises(FolderError, match="cannot write"):
        refuse_foreign(tmp_path / "round")
    with pytest.raises(FolderError, match=r"cannot write .*too long"):
        refuse_foreign(tmp_path / ("x" * 300))
    if os.geteuid() == 0:  # who may write everywhere becomes another
        (child := os.fork()) or _as_another(tmp_path)
        assert os.waitpid(child, 0)[1] == 0
    else:
        _refused_without_permission(tmp_path)


def _as_another(tmp_path: Path) -> None:
    try:
        os.setuid(65534)
        _refused_without_permission(tmp_path)
        os._exit(0)
    finally:
        os._exit(1)


def _refused_without_permission(tmp_path: Path) -> None:
    try:
        refuse_foreign(Path("/usr/part"))
    except FolderError as error:
        assert "no permission to write in /usr" in str(error) and "-o" in str(error)
    else:
        raise AssertionError("not refused")
