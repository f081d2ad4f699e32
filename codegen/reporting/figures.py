"""Figures of a report as SVG by matplotlib, readable in black and white, from the numbers of `measure`."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..measure.drawing import STYLES as ALL_STYLES
from ..measure.drawing import drawing, rows_of_points, under_the_roof

METHODS = ("dop853", "radau", "rk4")
STYLES = dict(zip(METHODS, ALL_STYLES, strict=False))
NAMES = {"rk4": "RK4, constant steps", "dop853": "Dormand-Prince 8(5,3)", "radau": "Radau IIA 5"}

ROUNDING = float(np.finfo(float).eps) / 2
"""Smaller errors are drawn at this value, since a logarithmic axis has no zero."""


def figures(data: dict[str, Any]) -> dict[str, str]:
    """SVG text of all figures for which there are numbers, by name."""
    found: dict[str, str] = {}
    if data.get("times"):
        found["times"] = times(data["times"])
    if data.get("errors"):
        found["errors"] = errors(data["errors"])
    motions = data.get("motions")
    if motions and any(motions["methods"].values()):
        found["work_precision"] = work_precision(motions)
    if data.get("differences"):
        found["differences"] = differences(data["differences"])
    if motions and motions.get("conditions"):
        found["conditions"] = conditions(motions["conditions"])
    if data.get("roofline"):
        found["roofline"] = roofline(data["roofline"])
    return found


def times(data: dict[str, Any]) -> str:
    """Bars of the microseconds per state in C and of a single call from Python."""
    names = list(data["functions"])
    with drawing(7.2, 0.9 + 0.42 * len(names)) as (_, (ax,), text):
        y = np.arange(len(names))[::-1]
        for shift, kind, label, face, hatch in ((0.18, "compiled", "in C, per state of a batch", "#333333", ""),
                                                (-0.18, "call", "one call from Python", "#ffffff", "////")):  # fmt: skip
            least = np.array([1e6 * data["functions"][n][kind]["least"] for n in names])
            high = np.array([1e6 * data["functions"][n][kind]["high"] for n in names])
            ax.barh(y + shift, least, 0.34, label=label, facecolor=face, edgecolor="#000000", hatch=hatch, linewidth=0.7,
                    xerr=[np.zeros_like(least), high - least], error_kw={"linewidth": 0.8, "capsize": 2})  # fmt: skip
        ax.set_yticks(y, names)
        ax.set(xscale="log", xlabel="microseconds per evaluation (least; whisker: 90 % of the turns)")
        ax.grid(False, axis="y")
        ax.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2, borderaxespad=0)
    return text[0]


def errors(data: list[dict[str, Any]]) -> str:
    """Dots for the relative errors of udot and of each derivative, state by state."""
    label = "relative error against the generic engine in extended precision (dashed: rounding of a double)"
    with rows_of_points([r["state"] for r in data], label) as (ax, places, text):
        for y, record in zip(places, data, strict=True):
            derivatives = np.maximum(list(record["derivatives"].values()), ROUNDING)
            ax.plot(derivatives, np.full(len(derivatives), y - 0.12), "o", markersize=4, markerfacecolor="none", color="#000000",
                    label="derivatives, one dot a direction" if y == len(data) - 1 else None)  # fmt: skip
            ax.plot(max(record["udot"], ROUNDING), y + 0.12, "D", markersize=5, color="#000000",
                    label="accelerations" if y == len(data) - 1 else None)  # fmt: skip
        ax.axvline(2 * ROUNDING, color="#8a8a8a", linewidth=0.8, linestyle=(0, (5, 2)))
        ax.set_xscale("log")
        left, right = ax.get_xlim()
        ax.set_xlim(min(left, 1e-17), max(right, 1e-13))
    return text[0]


def work_precision(data: dict[str, Any]) -> str:
    """Time over error: the state on the left, the sensitivities on the right."""
    sensitive = bool(data["sensitivities"])
    with drawing(7.2 if sensitive else 4.2, 3.6, 2 if sensitive else 1) as (_, axes, text):
        for ax, key, floor, title in zip(axes, ("error", "sensitivity_error"),
                                         ("reference_error", "reference_error_sensitivities"),
                                         ("state", "sensitivities, the worst"), strict=False):  # fmt: skip
            for method, points in data["methods"].items():
                shown = [p for p in points if p[key] is not None and p[key] < 1]
                ax.plot([max(p[key], ROUNDING) for p in shown], [1e3 * p["seconds"] for p in shown], label=NAMES[method],
                        markersize=4, linewidth=1, **STYLES[method])  # fmt: skip
            if not any(line.get_xdata().size for line in ax.get_lines()):  # a logarithmic axis needs a positive value
                ax.set_xlim(ROUNDING, 1)
                ax.set_ylim(0.1, 1e3)
            if data[floor] > 0:
                ax.axvspan(ax.get_xlim()[0], data[floor], color="#eeeeee", linewidth=0)
            ax.set(xscale="log", yscale="log", xlabel="relative error at the end")
            ax.invert_xaxis()
            ax.set_title(
                title, fontsize=9, pad=22 if sensitive else 34
            )  # space for the legend, so that it covers no point
        axes[0].set_ylabel("milliseconds, in C")
        legend = axes[0].legend(
            loc="lower left", bbox_to_anchor=(0, 1.01), ncols=3 if sensitive else 2, fontsize=8, borderaxespad=0
        )
        legend.set_in_layout(False)  # the legend is wider than these axes
    return text[0]


def differences(data: dict[str, Any]) -> str:
    """Error of finite differences over the step, and the error of the exact derivative as a horizontal line."""
    with drawing(6.2, 3.6) as (_, (ax,), text):
        for kind, marker, dashes, label in (("forward", "s", (0, (1, 1.2)), "one-sided differences"),
                                            ("central", "^", (0, (5, 2)), "central differences")):  # fmt: skip
            shown = [(h, e) for h, e in zip(data["steps"], data[kind], strict=True) if e is not None]
            ax.plot([h for h, _ in shown], [max(e, ROUNDING) for _, e in shown], marker=marker, linestyle=dashes, markersize=3.5,
                    linewidth=1, color="#555555", label=label)  # fmt: skip
        if data["exact"] is not None:
            ax.axhline(
                max(data["exact"], ROUNDING), color="#000000", linewidth=1.6, label="exact, by the generated solver"
            )
        ax.set(xscale="log", yscale="log", xlabel=f"step in {data['by']}", ylabel="relative error of d udot")
        ax.set_ylim(top=10)
        ax.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=3, fontsize=8, borderaxespad=0)
    return text[0]


def conditions(data: dict[str, Any]) -> str:
    """A figure of condition numbers over time."""
    with drawing(6.2, 2.8) as (_, (ax,), text):
        for key, dashes, label in (
            ("closures", "-", "closures, the worst"),
            ("mass_matrix", (0, (5, 2)), "mass matrix"),
        ):
            if key in data:
                finite = [c if np.isfinite(c) else np.nan for c in data[key]]
                ax.plot(data["t"], finite, linestyle=dashes, color="#000000", linewidth=1, label=label)
        ax.set(yscale="log", xlabel="t in s", ylabel="condition")
        ax.set_ylim(1, max(10, 1.5 * ax.get_ylim()[1]))
        ax.legend(loc="best", fontsize=8)
    return text[0]


def roofline(data: dict[str, Any]) -> str:
    """A figure of operations per second over operations per byte, with the limits of the core."""
    with under_the_roof(data["peaks"]) as (ax, text):
        for point, marker in zip(data["points"], "os^", strict=True):
            ax.plot(
                point["per_byte"], point["per_second"] / 1e9, marker, color="#000000", markersize=6, label=point["name"]
            )
    return text[0]
