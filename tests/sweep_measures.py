"""Measures for tests of sweeps, in a module, so that other processes can import them."""

import os
import signal
import time
from pathlib import Path

import numpy as np


def swung(solver, case):
    """The position of the block after a second, and its derivative with respect to the stiffness."""
    motion = solver.simulate([0.0, 1.0], p={"stiffness": case["stiffness"]}, sensitivities="stiffness")
    return {"x": motion["x"][-1], "dx": motion.derivative("x", "stiffness")[-1], "process": os.getpid()}


def deadly(solver, case):
    """The same measure, which ends its process in one case."""
    if case["stiffness"] == 5.0:
        os.kill(os.getpid(), signal.SIGKILL)
    return swung(solver, case)


def slow(solver, case):
    """The same measure, slowed down; every call leaves a file."""
    with open(Path(case["folder"]) / "calls", "a") as file:
        file.write(f"{case['stiffness']}\n")
    time.sleep(0.02)
    return swung(solver, case)


def misspelt(solver, case):
    """A measure with an error in every case."""
    return {"x": solver.simulat([0.0, 1.0])["x"]}


def several(solver, case):
    """A measure with results of every kind."""
    if case["k"] == 2:
        raise ValueError("two is\nno good")
    return {
        "k": case["k"] ** 2,
        "position": np.array([1.0, case["k"]]),
        "word": "yes",
        "whole": np.int64(case["k"]),
        "good": True,
    }
