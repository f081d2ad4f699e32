"""Controls of a view: the time of a motion, coordinates, and design parameters."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..arrays import Array
from .viewer import RATE, Viewer

SPEEDS = ("0.1", "0.25", "0.5", "1", "2", "5")
"""Speeds of playback, relative to the speed of the motion."""

MOST_SLIDERS = 24
"""Maximum number of sliders of each kind; the view states the number of names without a slider."""


class Playback:
    """A time slider, a button to play and a choice of speeds, for a view of a motion.

    Parameters
    ----------
    viewer : Viewer
    """

    def __init__(self, viewer: Viewer):
        self.viewer = viewer
        gui, t = viewer.server.gui, viewer.poses.t
        self.slider = gui.add_slider("time (s)", float(t[0]), float(t[-1]), _step(t[0], t[-1]), float(t[0]))
        self.button = gui.add_button("Play")
        self.speed = gui.add_dropdown("speed", SPEEDS, initial_value="1")
        self.playing = threading.Event()
        self.slider.on_update(lambda _: viewer.show(int(np.searchsorted(viewer.poses.t, self.slider.value))))
        self.button.on_click(lambda _: self._switch())
        threading.Thread(target=self._play, daemon=True).start()

    def _switch(self) -> None:
        """Play, or pause."""
        if self.playing.is_set():
            self.playing.clear()
            self.button.label = "Play"
        else:
            self.playing.set()
            self.button.label = "Pause"

    def _play(self) -> None:
        """Advance the time while the button is on; begin again at the end."""
        while True:
            self.playing.wait()
            began = time.perf_counter()
            time.sleep(1.0 / RATE)
            t = self.viewer.poses.t
            later = self.slider.value + float(self.speed.value) * (time.perf_counter() - began)
            self.slider.value = later if later <= t[-1] else float(t[0])


def add_choices(viewer: Viewer) -> None:
    """Adds controls for colours by a quantity and for forces, if the view has such quantities or forces."""
    gui = viewer.server.gui
    if viewer.poses.shades:
        plain = "body"
        by = gui.add_dropdown(
            "colour by", (plain, *viewer.poses.shades), hint="distance that a body moves with a parameter"
        )

        def colored(_: object) -> None:
            viewer.shade = "" if by.value == plain else by.value
            viewer.show(viewer.i)

        by.on_update(colored)
    for kind in viewer.poses.arrows:
        box = gui.add_checkbox(f"arrows: {kind}", kind in viewer.arrows)

        def switched(_: object, kind: str = kind, box: Any = box) -> None:
            (viewer.arrows.add if box.value else viewer.arrows.discard)(kind)
            viewer.show(viewer.i)

        box.on_update(switched)


class Sliders:
    """Sliders for named numbers, and a line for errors in their values.

    While the view shows a change, further changes wait; only the last one is shown next.

    Parameters
    ----------
    viewer : Viewer
    title : str
        Heading of the sliders.
    names, units : sequence of str
    values, low, high : ndarray (n,)
    changed : callable
        Called with all n numbers, in a thread of its own. The view shows the message of an error that it raises.
    """

    def __init__(
        self, viewer: Viewer, title: str, names: Sequence[str], units: Sequence[str], values: Array, low: Array, high: Array,
        changed: Callable[[Array], None],
    ):  # fmt: skip
        self.values, self.changed, self.lock = values.astype(float).copy(), changed, viewer.lock
        gui = viewer.server.gui
        self.wanted = threading.Event()
        self.sliders: dict[str, Any] = {}
        with gui.add_folder(title):
            for i, name in enumerate(names[:MOST_SLIDERS]):
                label = f"{name} ({units[i]})" if units[i] else name
                slider = gui.add_slider(label, float(low[i]), float(high[i]), _step(low[i], high[i]), float(values[i]))
                slider.on_update(lambda _, i=i, slider=slider: self._set(i, slider.value))
                self.sliders[name] = slider
            if len(names) > MOST_SLIDERS:
                gui.add_markdown(f"and {len(names) - MOST_SLIDERS} more without a slider")
            self.message = gui.add_markdown("")
        threading.Thread(target=self._follow, daemon=True).start()

    def _set(self, i: int, value: float) -> None:
        self.values[i] = value
        self.wanted.set()

    def _follow(self) -> None:
        """Shows each change; of several waiting changes, only the last."""
        while True:
            self.wanted.wait()
            self.wanted.clear()
            try:
                with self.lock:
                    self.changed(self.values.copy())
                self.message.content = ""
            except (ValueError, ArithmeticError, RuntimeError) as error:  # such as a motion that ends early
                self.message.content = str(error)


def around(values: Array) -> tuple[Array, Array]:
    """Lower and upper ends of sliders: 0.5 and 1.5 times each number, or -1 and 1 for zero."""
    half = np.where(values == 0.0, 1.0, np.abs(values) / 2)
    return values - half, values + half


def _step(low: float, high: float) -> float:
    """A step of a slider: about a thousandth of its length, as a round number."""
    length = float(high - low)
    return 10.0 ** math.floor(math.log10(length / 500.0)) if length > 0.0 else 1.0
