"""The data that a view sends to the browser for each frame, and how often a page requests a frame."""

import shutil
import subprocess

import numpy as np
import pytest

from codegen.runtime.standalone.display.scene import Mark
from codegen.runtime.standalone.display.viewer import RATE, SLOWER, _link_length, _send


class Node:
    """A node that records the arrays that it receives."""

    def __init__(self, **arrays):
        self.__dict__.update(arrays, sent=[])

    def __setattr__(self, name, value):
        self.sent.append(name)
        self.__dict__[name] = value


def test_arrays_that_stay_are_not_sent_again():
    turns, places = np.full((2, 4), 1 / 3), np.array([[0.1, 0.2, 0.3], [1.0, 2.0, 3.0]])
    node = Node(turns=turns.astype(np.float32), places=places.astype(np.float32))
    _send(node, turns=turns, places=places)
    assert node.sent == []
    moved = places.copy()
    moved[1, 0] += 1e-6
    _send(node, turns=turns, places=moved)
    assert node.sent == ["places"] and np.array_equal(node.places, moved.astype(np.float32))
    _send(node, places=places[:1])  # fewer nodes
    assert node.sent == ["places", "places"] and node.places.shape == (1, 3)


def test_many_marks_are_smaller_than_links():
    marks = [
        Mark("a", 0, np.zeros(3)),
        Mark("b", 1, np.array([0.0, 0.3, 0.4])),
        Mark("c", 2, np.array([0.5, 0.0, 0.0])),
    ]
    assert _link_length(marks) == 0.5 and _link_length(marks[:1]) == np.inf


def test_a_page_asks_for_a_frame_as_often_as_poses_change():
    if (program := shutil.which("node")) is None:
        pytest.skip("needs Node.js: https://nodejs.org")
    asked = "let found = []; setInterval = (f, ms, ...given) => found.push([f(...given), ms]); "
    calls = "setInterval(x => x + 1, 1000/120, 5); setInterval(() => 0, 1000); console.log(JSON.stringify(found))"
    script = asked + SLOWER.removeprefix("<script>").removesuffix("</script>") + ";" + calls
    done = subprocess.run([program, "-e", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == f"[[6,{1000 / RATE:.1f}],[0,1000]]"
