"""Journals of sweeps: their keys, the files that they leave unchanged, and damaged journals."""

import functools
import importlib.util
import json
import os
import random
import sys

import numpy as np
import pytest
from oscillator import oscillator

import codegen
from codegen.design.measure_digest import measure_digest
from codegen.design.sweep_journal import Journal, SweepJournalError

CASES = {"k": [1.0, 2.0, 3.0]}


@pytest.fixture(scope="module")
def solver(tmp_path_factory):
    return oscillator(tmp_path_factory.mktemp("journal"))


def from_text(folder, text, name="my_measures"):
    """A newly imported module with the given text."""
    file = folder / f"{name}.py"
    file.write_text(text)
    spec = importlib.util.spec_from_file_location(name, file)
    sys.modules[name] = module = importlib.util.module_from_spec(spec)
    exec(compile(text, str(file), "exec"), vars(module))
    return module


TEXT = '''
import helpers
GAIN = 2.0
TABLE = {"a": 1.0}
COUNT = 0
CALLS = []
class Law:
    slope = 1.0
    def value(self, x):
        return self.slope * x
def twice(x):
    return 2 * x
def measure(solver, case, power=2):
    """What it measures."""
    global COUNT
    COUNT += 1
    CALLS.append(case)
    inner = lambda x: x ** power  # a power
    return {"y": GAIN * twice(inner(case["k"])) + TABLE["a"] + Law().value(1.0) + helpers.offset()}
'''
HELPERS = "BASE = 1.0\ndef offset():\n    return BASE\n"

CHANGES = {
    "body": ("x ** power", "x ** power + 1"),
    "default": ("power=2", "power=3"),
    "global": ("GAIN = 2.0", "GAIN = 3.0"),
    "table": ('{"a": 1.0}', '{"a": 1.5}'),
    "helper": ("return 2 * x", "return 3 * x"),
    "class": ("self.slope * x", "self.slope + x"),
    "attribute": ("slope = 1.0", "slope = 1.5"),
    "module": ("BASE = 1.0", "BASE = 2.0"),
    "module's function": ("return BASE", "return -BASE"),
}
SAME = {
    "comment": ("# a power", "# another comment"),
    "docstring": ("What it measures.", "Something."),
    "blank lines": ("def measure", "\n\n\ndef measure"),
}


@pytest.mark.parametrize("change", [*CHANGES, *SAME])
def test_what_a_measure_is_known_by(tmp_path, monkeypatch, change):
    monkeypatch.setitem(sys.modules, "helpers", None)
    digests = []
    for old, new in (("", ""), (CHANGES | SAME)[change]):
        from_text(tmp_path, HELPERS.replace(old, new), "helpers")
        digests.append(measure_digest(from_text(tmp_path, TEXT.replace(old, new)).measure))
    assert (digests[0] == digests[1]) == (change in SAME)


def test_calls_do_not_change_what_a_measure_is_known_by(tmp_path):
    from_text(tmp_path, HELPERS, "helpers")
    module = from_text(tmp_path, TEXT)
    before = measure_digest(module.measure)
    for _ in range(100):  # Python specialises its code meanwhile
        module.measure(None, {"k": 1.0})
    assert len(module.CALLS) == module.COUNT == 100
    assert measure_digest(module.measure) == before


def test_what_a_measure_closes_over(tmp_path):
    def made(gain, table=(), calls=None):
        def measure(solver, case):
            if calls is not None:
                calls.append(case)
            return {"y": gain * case["k"] + sum(table)}

        return measure

    same = {measure_digest(made(2.0)), measure_digest(made(2.0)), measure_digest(made(2.0, calls=None))}
    assert len(same) == 1
    assert measure_digest(made(3.0)) not in same
    others = [made(2.0, [1.0]), made(2.0, [2.0]), made(2.0, np.ones(3)), made(2.0, np.ones(4)), made(np.float32(2.0))]
    assert len({measure_digest(m) for m in others} | same) == 6
    assert measure_digest(made(2.0, calls=[])) == measure_digest(made(2.0, calls=[1, 2]))
    partial = [functools.partial(made(2.0), power=n) for n in (1, 1, 2)]
    assert [measure_digest(p) == measure_digest(partial[0]) for p in partial] == [True, True, False]


class Measure:
    def __init__(self, gain):
        self.gain = gain

    def __call__(self, solver, case):
        return {"y": self.gain * case["k"]}

    def method(self, solver, case):
        return self(solver, case)


def test_objects_and_methods_are_known_by_their_values():
    for of in (lambda x: x, lambda x: x.method):
        one, same, other = (measure_digest(of(Measure(gain))) for gain in (1.0, 1.0, 2.0))
        assert one == same != other


def test_a_changed_measure_is_refused(solver, tmp_path):
    """Its name is the same; before, the old values came back."""
    journal = tmp_path / "sweep.jsonl"
    first = from_text(tmp_path, "def measure(solver, case):\n    return {'y': case['k']}\n").measure
    found = codegen.sweep(solver, CASES, first, journal=journal)
    assert found.from_journal == 0 and "journal" not in repr(found)
    again = codegen.sweep(solver, {"k": [2.0, 3.0, 4.0]}, first, journal=journal)
    assert again.from_journal == 2 and "2 from the journal" in repr(again)
    changed = from_text(tmp_path, "def measure(solver, case):\n    return {'y': 2*case['k']}\n").measure
    before = journal.read_bytes()
    with pytest.raises(SweepJournalError, match=r"the code of the measure, or a value that it refers to, has changed"):
        codegen.sweep(solver, CASES, changed, journal=journal)
    assert journal.read_bytes() == before
    solver.bad_states = "nan"
    try:
        with pytest.raises(SweepJournalError, match=r"bad_states was 'error', but is 'nan' here"):
            codegen.sweep(solver, CASES, first, journal=journal)
    finally:
        solver.bad_states = "error"


def test_failures_are_tried_again_on_request(solver, tmp_path):
    (tmp_path / "no").touch()

    def measure(solver, case):
        if case["k"] == 2.0 and (tmp_path / "no").exists():
            raise ValueError("not today")
        return {"y": case["k"]}

    journal = tmp_path / "sweep.jsonl"
    assert list(codegen.sweep(solver, CASES, measure, journal=journal).failures) == [1]
    (tmp_path / "no").unlink()
    kept = codegen.sweep(solver, CASES, measure, journal=journal)
    assert list(kept.failures) == [1] and kept.from_journal == 3
    mended = codegen.sweep(solver, CASES, measure, journal=journal, retry_failed=True)
    assert not mended.failures and mended.from_journal == 2 and mended["y"].tolist() == CASES["k"]
    assert not codegen.sweep(solver, CASES, measure, journal=journal).failures, "the last line of a case counts"


def plain(solver, case):
    return {"y": case["k"]}


FOREIGN = {
    "text": b"Dear reader,\nyours.\n",
    "no line end": b"one line without an end",
    "one brace": b"{",
    "cut": b"a,b\n1,2\n3,",
    "zeros": bytes(1000),
    "other JSON lines": b'{"a": 1}\n{"a": 2}\n',
    "a list": b"[1, 2]\n",
    "deep": b"[" * 100000 + b"\n",
    "long number": b"9" * 10000 + b"\n",
    "no text": b"\xff\xfe\x00\x01\n",
    "journal of another kind": b'{"format": "something"}\n{"case"',
}


@pytest.mark.parametrize("kind", FOREIGN)
def test_what_is_no_journal_stays_as_it_is(solver, tmp_path, kind):
    file = tmp_path / "file"
    file.write_bytes(FOREIGN[kind])
    with pytest.raises(SweepJournalError, match="is not the journal of a sweep and was not changed"):
        codegen.sweep(solver, CASES, plain, journal=file)
    assert file.read_bytes() == FOREIGN[kind]


def test_a_journal_that_another_sweep_was_cut_in_stays_too(solver, tmp_path):
    journal = tmp_path / "sweep.jsonl"
    codegen.sweep(solver, CASES, plain, journal=journal)
    with open(journal, "ab") as file:
        file.write(b'{"case": {"k"')
    before = journal.read_bytes()
    with pytest.raises(SweepJournalError, match="another sweep"):
        codegen.sweep(solver, CASES, lambda solver, case: {}, journal=journal)
    assert journal.read_bytes() == before
    assert codegen.sweep(solver, CASES, plain, journal=journal).from_journal == 3
    assert journal.read_bytes() == before.rpartition(b"\n")[0] + b"\n"


ROWS = [
    "null", "3", "[]", "{}", '{"case": 3, "values": {}}', '{"case": {"k": []}, "values": {}}', '{"case": {"k": 1.0}}',
    '{"case": {"k": 1.0}, "values": 3}', '{"case": {"k": 1.0}, "values": {"y": {"z": 1}}}', '{"case": {"k": 1.0}, "failed": 3}',
    "[" * 100000, "9" * 10000, '{"case"', "\0", "",
]  # fmt: skip


@pytest.mark.parametrize("row", ROWS, ids=lambda x: x[:30])
def test_damaged_rows_are_named(solver, tmp_path, row):
    journal = tmp_path / "sweep.jsonl"
    codegen.sweep(solver, CASES, plain, journal=journal)
    lines = journal.read_text().splitlines()
    lines[2] = row
    journal.write_text("\n".join(lines) + "\n")
    before = journal.read_bytes()
    with pytest.raises(SweepJournalError, match="is damaged in line 3 and was not changed; remove this line"):
        codegen.sweep(solver, CASES, plain, journal=journal)
    assert journal.read_bytes() == before


def test_a_journal_is_a_regular_file(solver, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(SweepJournalError, match="pipe is not a regular file"):
        codegen.sweep(solver, CASES, plain, journal=tmp_path / "pipe")


@pytest.mark.parametrize("cut", [0, 30, 100])
def test_a_first_line_that_was_cut_short_is_written_anew(solver, tmp_path, cut):
    journal = tmp_path / "sweep.jsonl"
    codegen.sweep(solver, CASES, plain, journal=journal)
    journal.write_bytes(journal.read_bytes()[:cut])
    assert codegen.sweep(solver, CASES, plain, journal=journal).from_journal == 0
    assert json.loads(journal.read_text().splitlines()[0])["format"] == "ordernm sweep"


@pytest.mark.campaign
def test_journals_damaged_in_many_places(solver, tmp_path):
    """Seed 1: what is refused stays byte for byte; what is taken loses no more than a line that was cut."""
    journal = tmp_path / "sweep.jsonl"
    codegen.sweep(solver, {"k": [float(k) for k in range(6)]}, plain, journal=journal)
    content, rng, refused = journal.read_bytes(), random.Random(1), 0
    for _ in range(4000):
        damaged = bytearray(content)
        for _ in range(rng.randint(1, 4)):
            i, kind = rng.randrange(len(damaged) or 1), rng.random()
            if kind < 0.4 and damaged:
                damaged[i] = rng.randrange(256)
            elif kind < 0.6:
                del damaged[i : i + rng.randint(1, 30)]
            elif kind < 0.8:
                damaged[i:i] = rng.choice([b"[", b"{", b"\n", b"NaN", b"1e999", b"\xff", b'"']) * rng.randint(1, 5)
            else:
                del damaged[i + 1 :]
        journal.write_bytes(damaged)
        try:
            Journal(journal, solver, plain).close()
        except SweepJournalError:
            refused += 1
            assert journal.read_bytes() == bytes(damaged)
        else:
            after = journal.read_bytes()
            assert bytes(damaged).startswith(after) or b"\n" not in damaged  # a first line that was cut is written anew
    assert refused > 2000
