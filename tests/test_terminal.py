"""Output on terminals and pipes: colour, line breaks between words, one progress line, and Ctrl-C."""

import contextlib
import dataclasses
import fcntl
import io
import os
import pty
import re
import signal
import struct
import subprocess
import sys
import termios
import time
from pathlib import Path

import pytest

import codegen
import codegen.pipeline
from codegen import terminal
from codegen.cli import generate_main, main, print_report
from codegen.terminal import StatusLine, wrapped

ROOT = Path(codegen.__file__).parents[1]
MODEL = ROOT / "examples" / "double_pendulum.yaml"
AT_ONCE = """
import os, signal, sys, time
from codegen import terminal
from codegen.cli import main

def slowly(self, stage, step, steps, call=terminal.StatusLine.__call__):
    call(self, stage, step, steps)
    if (stage, step) == ("expanding", 2) and self._timer is not None:
        end = time.monotonic() + 30
        while self._live is None and time.monotonic() < end:
            time.sleep(0.01)
        time.sleep(0.5)
        if "INTERRUPT" in os.environ:
            signal.raise_signal(signal.SIGINT)

terminal.PATIENCE, terminal.StatusLine.__call__ = 0.0, slowly
sys.exit(main())
"""
"""The command with a terminal that is told at once what takes so long, and half a second of it."""


def environment(**more: str) -> dict[str, str]:
    left_out = ("CI", "NO_COLOR", "FORCE_COLOR", "COLUMNS", "LINES", "TERM")
    kept = {k: v for k, v in os.environ.items() if k not in left_out}
    return {**kept, "PYTHONPATH": str(ROOT), "TERM": "xterm", **more}


def on_a_terminal(cwd: Path, *arguments: object, columns: int = 80, **more: str) -> tuple[int, str]:
    """Exit code of the command on a terminal of a given width, and its whole output."""
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
    command = [sys.executable, "-c", AT_ONCE, *map(str, arguments)]
    with subprocess.Popen(
        command, cwd=cwd, env=environment(**more), stdin=theirs, stdout=theirs, stderr=theirs
    ) as process:
        os.close(theirs)
        text = b""
        with contextlib.suppress(OSError):  # how a terminal ends
            while part := os.read(ours, 65536):
                text += part
        os.close(ours)
        return process.wait(), text.decode()


def screen(text: str) -> list[str]:
    """The text on the screen at the end, after carriage returns, erased lines and cursor movements."""
    lines, row, column = [""], 0, 0
    for token in re.findall(r"\x1b\[[0-9;?]*[A-Za-z]|[\s\S]", text):
        if token == "\r":
            column = 0
        elif token == "\n":
            row += 1
            lines += [""] * (row == len(lines))
        elif token.endswith("A") and token.startswith("\x1b"):
            row -= int(token[2:-1] or 1)
        elif token == "\x1b[2K":
            lines[row] = ""
        elif not token.startswith("\x1b"):
            lines[row] = lines[row][:column].ljust(column) + token + lines[row][column + 1 :]
            column += 1
    return [line.rstrip() for line in lines]


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    """The output of a run on a terminal with 80 columns."""
    place = tmp_path_factory.mktemp("terminal")
    return place, *on_a_terminal(place, "generate", MODEL, "-o", "out", "--target", "numpy")


def test_a_terminal_is_told_what_takes_so_long(seen):
    _, code, text = seen
    assert code == 0
    assert re.search(r"[-|/\\] expanding, 2 of \d+ \(\d+ s\)", text)
    # and the line goes away
    shown = "\n".join(screen(text))
    assert not re.search(r"\(\d+ s\)", shown)
    # a folder whose name is long stands in a line of its own
    assert shown.split()[0] == "double_pendulum" and "checked against the generic engine" in " ".join(shown.split())
    assert text.count("\x1b[?25l") == text.count("\x1b[?25h") == 1  # the cursor is back
    assert "\x1b[1m" in text  # the name in bold


def test_a_pipe_gets_the_report_only(seen, tmp_path):
    run = subprocess.run([sys.executable, "-c", AT_ONCE, "generate", MODEL, "-o", "out", "--target", "numpy"], cwd=tmp_path,
                         env=environment(), capture_output=True, text=True, check=False)  # fmt: skip
    assert run.returncode == 0 and run.stderr == "" and "\x1b" not in run.stdout and "\r" not in run.stdout

    def words(text: str, place: Path) -> list[str]:
        text = re.sub(r"\d+\.\d+ s\b|\d\.\de[-+]\d+", "#", " ".join(text.replace(str(place), "PLACE").split()))
        return text.split()

    # the same words as on the terminal, in lines as long as they are
    place, _, text = seen
    assert words(run.stdout, tmp_path) == words("\n".join(screen(text)), place)
    assert max(map(len, run.stdout.splitlines())) > 80


def test_no_colour_and_no_progress(tmp_path):
    code, text = on_a_terminal(tmp_path, "generate", MODEL, "--target", "numpy", "--no-check", NO_COLOR="1", CI="1")
    assert code == 0 and "\x1b" not in text


@pytest.mark.parametrize(
    ("variables", "colour", "moves"),
    [({}, True, True), ({"NO_COLOR": "1"}, False, True), ({"NO_COLOR": ""}, True, True), ({"TERM": "dumb"}, False, False),
     ({"CI": "true"}, False, False)],
)  # fmt: skip
def test_colours_and_progress_can_be_forbidden(monkeypatch, variables, colour, moves):
    for name in ("NO_COLOR", "CI"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("TERM", "xterm")
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    assert (terminal.can_colour(Screen()), terminal.can_move(Screen())) == (colour, moves)
    assert not terminal.can_colour(io.StringIO()) and not terminal.can_move(io.StringIO())
    written = Screen()
    terminal.write_lines(["a", "b"], written, ["bold"])
    assert written.getvalue() == ("\x1b[1ma\x1b[0m\nb\n" if colour else "a\nb\n")


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    return codegen.generate(MODEL, tmp_path_factory.mktemp("report") / "out", compile=False)


@pytest.mark.parametrize("columns", [40, 80, 200])
@pytest.mark.parametrize("verbose", [False, True])
def test_reports_end_lines_between_words(report, columns, verbose):
    lines = report.lines(verbose, columns)
    parts = [part for line in lines for part in wrapped(line, columns)]
    assert " ".join(parts).split() == " ".join(lines).split()
    assert [
        p for p in parts if len(p) > columns and len(p.split()) > 1
    ] == []  # a path may be one word that is too long

    def holds(table: list[str]) -> set[str]:  # a table that is too wide becomes a list of the same figures
        return set(re.sub(r"[,:]|\beach\b|\bsweep\b|\bpass\b", " ", " ".join(table)).split())

    assert holds(lines) == holds(report.lines(verbose))


def test_a_narrow_terminal_breaks_lines_between_words(tmp_path):
    code, text = on_a_terminal(tmp_path, "show", ROOT / "examples" / "satellite.yaml", columns=40)
    assert code == 0 and max(map(len, screen(text))) <= 40
    piped = subprocess.run([sys.executable, "-m", "codegen", "show", ROOT / "examples" / "satellite.yaml"], cwd=tmp_path,
                           env=environment(), capture_output=True, text=True, check=True).stdout  # fmt: skip
    assert " ".join(screen(text)).split() == piped.split()


def test_lines_are_wrapped_with_their_indent():
    assert wrapped("  ab cd ef", None) == ["  ab cd ef"]
    assert wrapped("  aaaa bbbb cccc dddd", 16) == ["  aaaa bbbb cccc", "      dddd"]
    assert wrapped("an-unbreakable-path/of/many/parts is one word", 20) == [
        "an-unbreakable-path/of/many/parts", "    is one word",
    ]  # fmt: skip


def test_warnings_and_remarks_are_coloured(report, monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    for name in ("NO_COLOR", "CI"):
        monkeypatch.delenv(name, raising=False)
    more = dataclasses.replace(
        report,
        folder=Path("out"),
        warnings=("x.yaml:1:1: warning: unused",),
        remarks=["no compiler"],
        loops=["warning: flat"],
    )
    monkeypatch.setattr(sys, "stdout", screen := Screen())
    print_report(more)
    coloured = re.findall(r"\x1b\[33m *(.*?)\x1b\[0m", screen.getvalue())
    assert coloured == ["x.yaml:1:1: warning: unused", "warning: flat", "no compiler"]
    assert screen.getvalue().count("\x1b[1m") == 1


class Screen(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_the_line_waits_and_is_gone_when_closed(monkeypatch):
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("CI", raising=False)
    quick = Screen()
    with StatusLine(quick) as status:
        status("expanding", 1, 2)
    assert quick.getvalue() == "" and status.where == "expanding, 1 of 2"
    monkeypatch.setattr(terminal, "PATIENCE", 0.0)
    slow = Screen()
    with StatusLine(slow) as status:
        status("compiling", 0, 0)
        deadline = time.monotonic() + 20
        while "compiling" not in slow.getvalue() and time.monotonic() < deadline:
            time.sleep(0.02)
    assert "compiling (0 s)" in slow.getvalue() and not "".join(screen(slow.getvalue()))
    written = slow.getvalue()
    time.sleep(0.3)
    assert slow.getvalue() == written  # no thread goes on


# ---- ending ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("number", "said"),
    [(signal.SIGINT, "interrupted"), (signal.SIGTERM, "ended by SIGTERM"), (signal.SIGHUP, "ended by SIGHUP")],
)
def test_signals_end_in_one_line(tmp_path, monkeypatch, capsys, number, said):
    def expand(*arguments, progress, **options):
        progress("expanding", 3, 21)
        signal.raise_signal(number)

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(codegen.pipeline, "write_solver", expand)
    before = signal.getsignal(number)
    assert generate_main([str(MODEL)]) == 128 + number
    out, err = capsys.readouterr()
    assert out == "" and err == f"generate: {said} while expanding, 3 of 21\n"
    assert list(tmp_path.iterdir()) == [] and signal.getsignal(number) == before


def test_ctrl_c_takes_the_line_of_progress_away(tmp_path):
    code, text = on_a_terminal(tmp_path, "generate", MODEL, INTERRUPT="1")
    assert code == 130 and "expanding, 2 of" in text and text.count("\x1b[?25h") == 1
    (line,) = filter(None, screen(text))
    assert re.fullmatch(r"generate: interrupted while expanding, 2 of \d+", line)
    assert list(tmp_path.iterdir()) == []


def test_ctrl_c_while_compiling(tmp_path):
    compiler = tmp_path / "cc"
    compiler.write_text('#!/bin/sh\n[ "$1" = --version ] && echo slow 1 && exit\necho $$ > compiling.new\n'
                        "mv compiling.new compiling\nexec sleep 60\n")  # fmt: skip
    compiler.chmod(0o755)
    process = subprocess.Popen(
        [sys.executable, "-m", "codegen", "generate", MODEL, "-o", "out/pendulum"], cwd=tmp_path,
        env=environment(CC=str(compiler)), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    deadline = time.monotonic() + 60
    while not (tmp_path / "compiling").exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=30)
    assert process.returncode == 130 and out == "" and err == "generate: interrupted while compiling\n"
    # the sources are there as a whole, and nothing of the making
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["pendulum"]
    found = {p.name for p in (tmp_path / "out" / "pendulum").iterdir()}
    assert "double_pendulum.c" in found and not [n for n in found if n.startswith(".") or n.endswith(".so")]


def test_a_reader_that_goes_away_is_no_error(tmp_path):
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "w") as pipe:
        run = subprocess.run([sys.executable, "-m", "codegen", "show", MODEL], cwd=tmp_path, env=environment(), stdout=pipe,
                             stderr=subprocess.PIPE, text=True, check=False)  # fmt: skip
    assert run.returncode == 128 + signal.SIGPIPE and run.stderr == ""


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is full")
def test_a_full_disk_is_told(tmp_path):
    with open("/dev/full", "w") as full:
        run = subprocess.run([sys.executable, "-m", "codegen", "show", MODEL], cwd=tmp_path, env=environment(), stdout=full,
                             stderr=subprocess.PIPE, text=True, check=False)  # fmt: skip
    assert run.returncode == 2 and run.stderr == "show: No space left on device\n"


def test_progress_from_python(tmp_path):
    heard: list[tuple[str, int, int]] = []
    codegen.generate(MODEL, tmp_path / "out", "numpy", check=True, progress=lambda *step: heard.append(step))
    stages = list(dict.fromkeys(stage for stage, _, _ in heard))
    assert stages == ["reading", "analysing", "finding zeros", "expanding", "simplifying", "printing C", "printing NumPy",
                      "writing", "checking"]  # fmt: skip
    for stage in ("finding zeros", "expanding", "simplifying"):
        steps = [(step, of) for s, step, of in heard if s == stage]
        assert steps == [(i, len(steps)) for i in range(1, len(steps) + 1)]

    class Enough(Exception):
        pass

    def stop(stage: str, step: int, steps: int) -> None:
        if stage == "writing":
            raise Enough

    with pytest.raises(Enough):
        codegen.generate(MODEL, tmp_path / "other", "numpy", progress=stop)
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_main_without_a_command_is_usage(capsys):
    with pytest.raises(SystemExit) as end:
        main([])
    assert end.value.code == 2 and "usage: ordernm" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["ordernm", "generate"])
def test_ctrl_c_while_modules_are_imported_is_no_traceback(command):
    """Before the command begins, and before anything of it can handle a signal."""
    program = f"""
import builtins, sys
real = builtins.__import__
def interrupted(name, globals=None, locals=None, fromlist=(), level=0):
    if "main" in (fromlist or ()) or "generate_main" in (fromlist or ()):
        raise KeyboardInterrupt
    return real(name, globals, locals, fromlist, level)
from codegen import entry
builtins.__import__ = interrupted
sys.exit(entry.{command}())
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT)
    assert (done.returncode, done.stderr) == (130, f"{command}: interrupted before it began\n")
    real = program.replace(
        '"main" in (fromlist or ()) or "generate_main" in (fromlist or ())',
        '"argparse" in name or level and "bench" in name',
    )
    done = subprocess.run([sys.executable, "-c", real, "--help"], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 130 and "Traceback" not in done.stderr


CALLS = """
import sys, time
import ordernm
from codegen import terminal

terminal.PATIENCE = 0.0
def slowly(self, stage, step, steps, call=terminal.StatusLine.__call__):
    call(self, stage, step, steps)
    time.sleep(0.3 if (stage, step) in (("expanding", 2), ("measuring cases", 2)) else 0.0)

terminal.StatusLine.__call__ = slowly
@terminal.working("fitting")
def fit():
    time.sleep(0.3)
fit()
model = ordernm.load_model(sys.argv[1])
ordernm.generate(model, "made", target="numpy")
solver = ordernm.load("made", target="numpy")
found = ordernm.sweep(solver, {"x": [1, 2, 3]}, lambda solver, case: {"y": case["x"]})
print(len(found))
"""


def calls_on_a_terminal(cwd, **more):
    ours, theirs = pty.openpty()
    with subprocess.Popen(
        [sys.executable, "-c", CALLS, str(MODEL)],
        cwd=cwd,
        env=environment(**more),
        stdout=subprocess.PIPE,
        stderr=theirs,
    ) as process:
        os.close(theirs)
        found = b""
        with contextlib.suppress(OSError):  # the other end is closed
            while part := os.read(ours, 4096):
                found += part
        os.close(ours)
        assert process.stdout.read() == b"3\n", found
    return found.decode()


def test_calls_from_python_show_their_progress_on_terminals_only(tmp_path):
    seen = calls_on_a_terminal(tmp_path)
    assert "fitting (0 s)" in seen and "expanding, 2 of" in seen and "measuring cases, 2 of 3" in seen
    assert seen.rstrip().endswith("\x1b[2K") or "\x1b[2K" in seen[-40:]  # erased at the end
    piped = subprocess.run(
        [sys.executable, "-c", CALLS, str(MODEL)], cwd=tmp_path, env=environment(), capture_output=True, text=True
    )
    assert (piped.stdout, piped.stderr) == ("3\n", "")


@pytest.mark.parametrize("more", [{"ORDERNM_PROGRESS": "off"}, {"CI": "1"}, {"TERM": "dumb"}], ids=str)
def test_calls_from_python_show_nothing_where_it_is_not_wanted(tmp_path, more):
    assert calls_on_a_terminal(tmp_path, **more) == ""


def test_a_call_within_another_shows_nothing_of_its_own(monkeypatch):
    monkeypatch.setattr(terminal, "is_watched", lambda stream: True)
    with terminal.shown() as outer, terminal.shown() as inner:
        assert outer is not None and inner is None
    with terminal.shown() as again:
        assert again is not None


def test_progress_that_is_given_is_used():
    seen = []

    @terminal.with_status("counting")
    def count(n, progress=None):
        for i in range(n):
            progress(i + 1, n)

    count(2, progress=lambda *x: seen.append(x))
    count(1, lambda *x: seen.append(x))
    assert seen == [(1, 2), (2, 2), (1, 1)]
