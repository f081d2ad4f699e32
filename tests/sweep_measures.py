"""Measures for tests of sweeps: functions of a module, which other processes can import."""

import os
import signal
import time
from pathlib import Path

import numpy as np


def swung(solver, case):
    """Where the block is after a second, and its derivative by the stiffness."""
    motion = solver.simulate([0.0, 1.0], p={"stiffness": case["stiffness"]}, sensitivities="stiffness")
    return {"x": motion["x"][-1], "dx": motion.derivative("x", "stiffness")[-1], "process": os.getpid()}


def deadly(solver, case):
    """The same, but for a case that ends its process."""
    if case["stiffness"] == 5.0:
        os.kill(os.getpid(), signal.SIGKILL)
    return swung(solver, case)


def slow(solver, case):
    """The same, taking its time and leaving a trace of every call."""
    with open(Path(case["folder"]) / "calls", "a") as file:
        file.write(f"{case['stiffness']}\n")
    time.sleep(0.02)
    return swung(solver, case)


def misspelt(solver, case):
    """An error in every case."""
    return {"x": solver.simulat([0.0, 1.0])["x"]}


def several(solver, case):
    """Kinds of results."""
    if case["k"] == 2:
        raise ValueError("two is\nno good")
    return {
        "k": case["k"] ** 2,
        "position": np.array([1.0, case["k"]]),
        "word": "yes",
        "whole": np.int64(case["k"]),
        "good": True,
    }
