"""Chooses the number of threads for a batch, unless the user sets it."""

from __future__ import annotations

import contextlib
import functools
import math
import os
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

from ..warning import warn

WORTH_A_THREAD = 100_000
"""Work in ns, on a single thread, that justifies one more thread for a batch."""

MANY = 1024
"""A number of threads that exceeds that of any batch."""

LIMIT = "OMP_NUM_THREADS"
"""The environment variable that limits the number of threads, as in other numerical libraries."""

CONTROL_GROUPS = Path("/sys/fs/cgroup")
OF_PROCESS = Path("/proc/self/cgroup")


ONE = "ordernm_one_thread"
"""Attribute of threads whose batches use one thread each. Run times of other versions, in other packages, read this
attribute, too."""


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Restricts batches of the current thread to one thread each, because the thread belongs to a pool that uses all
    processors."""
    here = threading.current_thread()
    before = getattr(here, ONE, False)
    setattr(here, ONE, True)
    try:
        yield
    finally:
        setattr(here, ONE, before)


def batch_threads(work: float) -> int:
    """Number of threads for a batch.

    Parameters
    ----------
    work : float
        Time on a single thread, in nanoseconds.

    Returns
    -------
    int
        One for small batches, within `one_thread` and in processes of `multiprocessing`. Otherwise at most one per processor that
        the process may use, and at most the number in `LIMIT`.
    """
    most = int(min(work / WORTH_A_THREAD, MANY))
    if most < 2 or getattr(threading.current_thread(), ONE, False) or _in_pool_of_processes():
        return 1
    return min(most, processors(), _limit())


def processors() -> int:
    """Number of processors that this process may use, by its affinity and control-group quotas; at least one."""
    may_use = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, int(min(may_use, _quota())))


def _in_pool_of_processes() -> bool:
    """Whether `multiprocessing` started this process, in which case it has already been imported."""
    module = sys.modules.get("multiprocessing.process")
    return module is not None and module.parent_process() is not None


def _limit() -> int:
    """The number of threads that `LIMIT` allows; `MANY` if it is not set."""
    text = os.environ.get(LIMIT, "").partition(",")[0].strip()  # OpenMP: one number for each level of nesting
    if not text:
        return MANY
    if not text.isdecimal() or int(text) < 1:
        warn(f"{LIMIT} is {text!r}, expected an integer of at least 1; it is ignored")
        return MANY
    return int(text)


@functools.cache
def _quota() -> float:
    """Processors that control groups (version 1 or 2) grant the process; infinite without a quota."""
    least = math.inf
    files: tuple[str, ...]
    for line in _read(OF_PROCESS).splitlines():
        _, controllers, path = line.split(":", 2)
        if not controllers:
            root, files = CONTROL_GROUPS, ("cpu.max",)
        elif "cpu" in controllers.split(","):
            root, files = CONTROL_GROUPS / "cpu", ("cpu.cfs_quota_us", "cpu.cfs_period_us")
        else:
            continue
        inner = root / path.lstrip("/")
        for group in (inner, *inner.parents):
            words = " ".join(_read(group / file) for file in files).split()
            if len(words) == 2 and all(word.isdecimal() and int(word) for word in words):  # else "max" or -1: no quota
                least = min(least, int(words[0]) / int(words[1]))
            if group == root:
                break
    return least


def _read(path: Path) -> str:
    try:
        return path.read_text()
    except OSError:
        return ""


__all__ = ["LIMIT", "batch_threads", "one_thread", "processors"]
