"""Sweeps over designs, by threads, processes and a cluster, against the closed form of an oscillator; workers that die."""

import functools
import json
import os
import signal
import subprocess
import sys
import textwrap
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest
import sweep_measures
from oscillator import oscillator, swing

import codegen
from codegen.design.sweep_journal import SweepJournalError

STIFFNESS = np.linspace(2, 12, 60)
PROCESSES = functools.partial(ProcessPoolExecutor, 2, mp_context=get_context("spawn"))


@pytest.fixture(scope="module")
def solver(tmp_path_factory):
    made = oscillator(tmp_path_factory.mktemp("sweep"))
    made.simulate(0.1)  # compiled before any worker asks for it
    return made


@pytest.fixture(autouse=True)
def importable(monkeypatch):
    """Makes the measures importable by other processes."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(Path(sweep_measures.__file__).parent), *sys.path]))


def right(found, stiffness=STIFFNESS):
    exact = [swing(1.0, stiffness=k) for k in stiffness]
    assert found["x"] == pytest.approx([x for x, _ in exact], abs=1e-8)
    assert found["dx"] == pytest.approx([d["stiffness"] for _, d in exact], abs=1e-7)
    assert not found.failures and not found.left and found.succeeded.all()


def test_threads_by_default(solver):
    seen = []
    found = codegen.sweep(solver, {"stiffness": STIFFNESS}, sweep_measures.swung, progress=lambda *x: seen.append(x))
    right(found)
    assert seen[0] == (0, 60) and seen[-1] == (60, 60) and sorted(seen) == seen
    assert found[3]["x"] == found["x"][3] and np.array_equal(found["stiffness"], STIFFNESS)
    right(codegen.sweep(solver, ({"stiffness": k} for k in STIFFNESS), sweep_measures.swung, chunk=60))


def test_processes_that_are_given(solver):
    with PROCESSES() as pool:
        found = codegen.sweep(solver, {"stiffness": STIFFNESS}, sweep_measures.swung, pool)
        right(found)
        assert os.getpid() not in found["process"]
        assert pool.submit(os.getpid).result() in found["process"], "the executor is the caller's, and stays open"


def test_a_case_that_ends_its_process_is_found_and_all_others_computed(solver):
    stiffness = np.arange(1.0, 31.0)
    found = codegen.sweep(solver, {"stiffness": stiffness}, sweep_measures.deadly, PROCESSES)
    assert found.failures == {4: "the process that computed it ended"} and not found.left
    well = stiffness != 5.0
    assert np.array_equal(found.succeeded, well) and np.isnan(found["x"][4])
    assert found["x"][well] == pytest.approx([swing(1.0, stiffness=k)[0] for k in stiffness[well]], abs=1e-8)


def test_what_an_executor_computed_before_it_died_is_kept(solver, tmp_path):
    stiffness = np.array([*np.linspace(6, 12, 40), 5.0, *np.linspace(1, 4, 60)])
    with PROCESSES() as pool, pytest.warns(RuntimeWarning, match=r"its executor died \(BrokenProcessPool") as told:
        found = codegen.sweep(
            solver, {"stiffness": stiffness}, sweep_measures.deadly, pool, chunk=1, journal=tmp_path / "sweep.jsonl"
        )
    assert told[0].filename == __file__
    assert 40 in found.left and not found.failures
    done = [i for i in range(101) if i not in found.left]
    assert len(done) >= 30, "nearly all that was sent before"
    assert found["x"][done] == pytest.approx([swing(1.0, stiffness=k)[0] for k in stiffness[done]], abs=1e-8)
    kept = (tmp_path / "sweep.jsonl").read_text().splitlines()
    assert len(kept) == len(done) + 1


def test_an_executor_that_was_shut_down(solver):
    pool = ThreadPoolExecutor(1)
    pool.shutdown()
    with pytest.warns(RuntimeWarning, match=r"cannot schedule new futures after shutdown.*0 of 60 cases"):
        found = codegen.sweep(solver, {"stiffness": STIFFNESS}, sweep_measures.swung, pool)
    assert found.left == list(range(60)) and found.names == ()


def test_executors_that_always_die_are_given_up(solver):
    dying = functools.partial(PROCESSES, initializer=os._exit, initargs=(1,))
    with pytest.warns(RuntimeWarning, match="its executor died"):
        found = codegen.sweep(solver, {"stiffness": STIFFNESS[:8]}, sweep_measures.swung, dying)
    assert not found.succeeded.any() and len(found.failures) <= 3


def test_a_killed_sweep_goes_on_where_it_was(solver, tmp_path):
    """The whole program is killed, a line of its journal is cut; nothing is computed twice but what was in the air."""
    journal = tmp_path / "sweep.jsonl"
    program = textwrap.dedent(f"""
        import numpy as np, codegen, sweep_measures
        codegen.sweep(codegen.load({str(solver.folder)!r}),
                      {{"stiffness": np.linspace(2, 12, 60), "folder": {str(tmp_path)!r}}},
                      sweep_measures.slow, journal={str(journal)!r}, chunk=1)
    """)
    running = subprocess.Popen([sys.executable, "-c", program])
    calls = tmp_path / "calls"
    while not (calls.exists() and len(calls.read_text().splitlines()) > 20):
        time.sleep(0.01)
    running.send_signal(signal.SIGKILL)
    running.wait()
    whole = journal.read_text().splitlines()
    journal.write_text("\n".join([*whole[:-1], whole[-1][:20]]))
    before = len(calls.read_text().splitlines())
    cases = {"stiffness": STIFFNESS, "folder": str(tmp_path)}
    right(codegen.sweep(solver, cases, sweep_measures.slow, journal=journal))
    after = len(calls.read_text().splitlines()) - before
    assert after == 60 - (len(whole) - 2)
    right(codegen.sweep(solver, cases, sweep_measures.slow, journal=journal))
    assert len(calls.read_text().splitlines()) == before + after, "everything is known"
    assert len({json.loads(line)["case"]["stiffness"] for line in journal.read_text().splitlines()[1:]}) == 60


def test_a_cluster_of_which_a_worker_is_killed(solver):
    distributed = pytest.importorskip("distributed", reason="needs Dask: pip install distributed")
    stiffness = np.linspace(2, 12, 400)
    killed = []
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):

        def look(done, n):
            if done >= 50 and not killed:
                killed.append(next(iter(cluster.workers.values())).pid)
                os.kill(killed[0], signal.SIGKILL)

        found = codegen.sweep(
            solver, {"stiffness": stiffness}, sweep_measures.swung, client.get_executor(), progress=look, chunk=5
        )
    right(found, stiffness)
    assert killed and set(found["process"]) - set(killed), "others went on"


def test_failures_are_recorded_and_tables_are_tidy(solver, tmp_path):
    found = codegen.sweep(solver, [{"k": k, "name": f"case {k}"} for k in range(4)], sweep_measures.several)
    (why,) = found.failures.values()
    assert why.startswith("ValueError: two is no good (") and "sweep_measures.py, line" in why
    assert found["k"].tolist() == [0, 1, 2, 3] and found.columns()["measured.k"].tolist()[3] == 9
    assert found["position[1]"].tolist()[3] == 3.0 and np.isnan(found["position[0]"][2])
    assert "4 cases, 1 failed, 0 not computed" in repr(found) and "two is no good" in repr(found)
    table = found.to_dataframe()
    assert list(table.columns) == [
        "k", "name", "measured.k", "position[0]", "position[1]", "word", "whole", "good", "failure"
    ]  # fmt: skip
    found.save(tmp_path / "x.parquet")
    found.save(tmp_path / "x.csv")
    pandas = pytest.importorskip("pandas", reason="needs pandas")
    for back in (pandas.read_parquet(tmp_path / "x.parquet"), pandas.read_csv(tmp_path / "x.csv")):
        assert list(back.columns) == list(table.columns) and back["whole"][3] == 3 and "two is" in back["failure"][2]
    again = codegen.sweep(solver, table[["k", "name"]], sweep_measures.several)
    assert again.cases == found.cases, "a table of pandas's holds cases too"
    with pytest.raises(KeyError, match=r"the sweep has no 'nothing'; it has k, name, measured.k, position"):
        found["nothing"]
    with pytest.raises(ValueError, match=r"ends in \.txt; sweeps are kept in files \.csv or \.parquet"):
        found.save(tmp_path / "x.txt")


def test_an_error_in_every_case_is_the_measures(solver, tmp_path):
    with pytest.raises(
        RuntimeError, match=r"failed in all \d+ cases so far.*: AttributeError.*simulat.*sweep_measures"
    ):
        codegen.sweep(solver, {"stiffness": STIFFNESS}, sweep_measures.misspelt, journal=tmp_path / "sweep.jsonl")
    assert len((tmp_path / "sweep.jsonl").read_text().splitlines()) == 1, "no case is called failed for that"


def test_mechanisms_that_fail_are_no_errors_of_the_measure(solver):
    def explode(solver, case):
        return {"x": solver.simulate(3.0, p={"cubic": case["cubic"]}, most_steps=2000)["x"][-1]}

    found = codegen.sweep(solver, {"cubic": [400.0] * 1 + [500.0 + k for k in range(10)]}, explode)
    assert len(found.failures) == 11 and all(why.startswith("SimulationError") for why in found.failures.values())


def test_ctrl_c_leaves_what_was_computed(solver):
    def stop(done, n):
        if done >= 20:
            raise KeyboardInterrupt

    found = codegen.sweep(solver, {"stiffness": STIFFNESS}, sweep_measures.swung, progress=stop, chunk=1)
    assert 20 <= found.succeeded.sum() < 60 and len(found.left) == 60 - found.succeeded.sum()


@pytest.mark.parametrize(
    ("cases", "told"),
    [
        ({"a": [1, 2], "b": [1, 2, 3]}, "numbers of values differ: a 2, b 3"),
        ({"a": 1}, "no name has several values"),
        ({"a": np.ones((2, 2))}, "a has more than one axis"),
        ([{"a": 1}, {"b": 1}], "case 1 differs from case 0 in the names a, b"),
        ([{"a": [1, 2]}], r"case 0: a is \[1, 2\], expected a number"),
        ([3], "case 0 is 3, expected a mapping"),
        ([{1: 3}], "case 0 has the name 1"),
        ("a", "cases is str"),
        (3, "cases is int"),
    ],
)
def test_cases_that_are_none(solver, cases, told):
    with pytest.raises((TypeError, ValueError), match=told):
        codegen.sweep(solver, cases, sweep_measures.swung)


def test_other_bad_input(solver, tmp_path):
    cases = {"stiffness": [2.0, 3.0]}
    with pytest.raises(TypeError, match="measure is int, expected a function"):
        codegen.sweep(solver, cases, 3)
    with pytest.raises(ValueError, match="chunk is 0"):
        codegen.sweep(solver, cases, sweep_measures.swung, chunk=0)
    with pytest.raises(TypeError, match=r"executor is 2, expected one of concurrent.futures"):
        codegen.sweep(solver, cases, sweep_measures.swung, lambda: 2)
    with pytest.raises(TypeError, match=r"executor is 2, expected one of concurrent.futures"):
        codegen.sweep(solver, cases, sweep_measures.swung, 2)
    with pytest.raises(RuntimeError, match="TypeError: measure returned int, expected a mapping"):
        codegen.sweep(solver, cases, lambda solver, case: 3)
    with PROCESSES() as pool, pytest.raises(TypeError, match=r"could not be sent.*must be a function of a module"):
        codegen.sweep(solver, cases, lambda solver, case: {"x": 1}, pool)
    journal = tmp_path / "sweep.jsonl"
    codegen.sweep(solver, cases, sweep_measures.swung, journal=journal)
    with pytest.raises(
        SweepJournalError, match=r"another sweep: measure was 'swung', but is 'deadly' here; choose another"
    ):
        codegen.sweep(solver, cases, sweep_measures.deadly, journal=journal)
    (tmp_path / "letter").write_text("Dear reader,\nyours.\n")
    with pytest.raises(SweepJournalError, match="letter is not the journal of a sweep and was not changed"):
        codegen.sweep(solver, cases, sweep_measures.swung, journal=tmp_path / "letter")
    assert (tmp_path / "letter").read_text() == "Dear reader,\nyours.\n"
    with pytest.raises(OSError):
        codegen.sweep(solver, cases, sweep_measures.swung, journal=tmp_path / "nowhere" / "sweep.jsonl")


def test_two_sweeps_do_not_write_one_journal(solver, tmp_path):
    journal = tmp_path / "sweep.jsonl"

    def inner(solver, case):
        codegen.sweep(solver, [{"a": 1}], lambda solver, case: {}, journal=journal)

    with pytest.raises(RuntimeError, match=r"SweepJournalError.*is being written by another sweep"):
        codegen.sweep(solver, [{"a": 2}], inner, journal=journal)
