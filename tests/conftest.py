"""Environment of every test: private caches, and hypothesis without deadlines, because compiling takes time."""

import contextlib
import gc
import os
import signal
import sys
from pathlib import Path

# Before anything imports NumPy: threads that wait for each other make small matrices slow on a busy machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# What is compiled runs a few times only; tests/emit/test_c.py has the flags of users, and the sanitizers -O2 and -O3. Where
# a test calls functions of three libraries or more, `compile="all"` is cheaper still.
os.environ.setdefault("ORDERNM_CFLAGS", "-O0 -march=native -ffp-contract=off")

import hypothesis
import pytest
from kept_files import Generator, make_room
from tiers import cpu_seconds, mark_campaign, mark_quick, sort_by_length

# Interpreters that tests start know `import ordernm` also where the checkout was installed before there was that name.
ALIAS = str(Path(__file__).parents[1] / "codegen" / "alias")
os.environ["PYTHONPATH"] = os.pathsep.join([ALIAS, *filter(None, [os.environ.get("PYTHONPATH")])])

# What a shell starts in the background ignores Ctrl-C, and under nohup the end of the terminal too; so would all that tests
# start.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

hypothesis.settings.register_profile("local", deadline=None)
hypothesis.settings.register_profile("ci", deadline=None, derandomize=True, database=None, print_blob=True)
hypothesis.settings.load_profile("ci" if os.environ.get("CI") else "local")


GENERATOR = Generator()
BEGUN = pytest.StashKey[float]()
"""CPU seconds of this process and those it has waited for when a test began."""


def pytest_configure(config):
    """If Python may not keep compiled modules beside their sources, pytest's cache keeps them.

    Rewriting and compiling the modules of all tests takes longer than everything else that collects them. Other processes
    of this run and interpreters that tests start have the same folder.

    pytest-xdist keeps the order of files, see `pytest_collection_modifyitems`.
    """
    config.option.loadscopereorder = False
    if "PYTHONDONTWRITEBYTECODE" in os.environ and hasattr(config, "cache"):
        with contextlib.suppress(OSError):  # a checkout that nobody may write to
            sys.pycache_prefix = str(config.cache.mkdir("bytecode"))
            sys.dont_write_bytecode = False
            os.environ["PYTHONPYCACHEPREFIX"] = sys.pycache_prefix
            del os.environ["PYTHONDONTWRITEBYTECODE"]


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """The garbage collector ignores objects that live until the end: the collected tests and the modules that they import.

    It runs after 300 000 new objects, not 700: writing a solver makes few cycles, and took a twentieth longer.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.collect()
        gc.freeze()
        gc.set_threshold(300_000)
        gc.enable()


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector):
    """Every second process of a run imports the tests from the end, so that they compile the modules for each other."""
    report = yield
    if int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")) % 2 and isinstance(collector, pytest.Dir):
        report.result.reverse()
    return report


def pytest_collection_modifyitems(items):
    """Mark quick tests, and cases that are left to the campaign; several processes begin with the longest files."""
    mark_campaign(items)
    mark_quick(items)
    if "PYTEST_XDIST_WORKER" in os.environ:
        sort_by_length(items)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item):
    item.stash[BEGUN] = cpu_seconds()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item, call):
    """JUnit files have the CPU seconds of each test, its fixtures included; `tiers.py` reads them."""
    if call.when == "teardown":
        item.user_properties.append(("cpu", f"{cpu_seconds() - item.stash[BEGUN]:.3f}"))
    return (yield)


@pytest.fixture(scope="session", autouse=True)
def private_cache(tmp_path_factory):
    """Store compiled solvers in a folder of this run, never in the user's cache."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="session")
def whole_run(tmp_path_factory):
    """A folder that all processes of this run share."""
    run = tmp_path_factory.getbasetemp()
    return run.parent if "PYTEST_XDIST_WORKER" in os.environ else run


@pytest.fixture(scope="session", autouse=True)
def python_compiled_once(whole_run):
    """Interpreters that tests start share compiled modules, even if the environment forbids keeping any."""
    with pytest.MonkeyPatch.context() as patch:
        if "PYTHONDONTWRITEBYTECODE" in os.environ:
            patch.delenv("PYTHONDONTWRITEBYTECODE")
            patch.setenv("PYTHONPYCACHEPREFIX", str(whole_run / "bytecode"))
        yield


@pytest.fixture(scope="session")
def kept(request, whole_run):
    """A folder for files that later runs need too, in pytest's cache; without that cache, one of this run."""
    try:
        return request.config.cache.mkdir("solvers")
    except (AttributeError, OSError):  # no cache provider, or a checkout that nobody may write to
        (folder := whole_run / "kept").mkdir(exist_ok=True)
        return folder


@pytest.fixture(scope="session", autouse=True)
def made_once(whole_run, kept):
    """Solvers are written and compiled once in all processes of this run, and their dependents chosen once; so also in
    later runs, as far as nothing has changed.

    A test that patches anything but the environment makes its own.
    """
    from once_a_run import chosen_once, compiled_once, noticing_patches, written_once

    replacing = set()

    def patched():
        return bool(replacing)

    if os.environ.get("PYTEST_XDIST_WORKER", "gw0") == "gw0":
        make_room(kept)
    with (
        compiled_once(kept),
        written_once(kept, GENERATOR, patched),
        chosen_once(kept, GENERATOR, patched),
        noticing_patches(replacing),
    ):
        yield
