"""Writes a report: one self-contained HTML page, the same in Markdown, and JSON."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from ..emit.templates import render
from ..folders import FolderError, write_folder
from ..measure.tables import Section, Table, number, seconds
from ..runtime.standalone.files.manifest import file_digest
from ..runtime.standalone.files.whole_file import MARK
from . import agreement, figures, processes

PAGE, MARKDOWN, NUMBERS, FIGURES = "index.html", "report.md", "report.json", "figures"


def need() -> None:
    """Raises ImportError with an installation hint if matplotlib is missing."""
    from ..runtime.standalone.trajectory.plot import need as need_matplotlib

    need_matplotlib()


def refuse_foreign(folder: Path, force: bool = False) -> list[str]:
    """Raise `FolderError` unless a report may be written into a folder.

    It may be absent or empty, or hold the unchanged files of an earlier report, as ``report.json`` lists them.

    Parameters
    ----------
    folder : Path
    force : bool
        Allow any contents: files of a report are replaced, others stay.

    Returns
    -------
    list of str
        Files that stay.
    """
    if folder.exists() and not folder.is_dir():
        raise FolderError(f"{folder} is a file; give a folder to write into with -o")
    if not folder.exists():
        return []
    here = Path.cwd()
    if folder.resolve() in (here, *here.parents):
        raise FolderError(f"{folder} is, or contains, the working directory; give a separate folder with -o")
    listed = _listed(folder)
    found = sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if not p.is_dir())
    foreign = [n for n in found if n != NUMBERS and n not in listed]
    changed = [n for n in found if n in listed and file_digest((folder / n).read_bytes()) != listed[n]]
    if NUMBERS in found and not listed:
        foreign.append(NUMBERS)
    if not force and (foreign or changed):
        several = [*foreign, *(f"{n} (changed since)" for n in changed)]
        raise FolderError(
            f"{folder} contains files that no report wrote: {', '.join(several[:5])}{', ...' if len(several) > 5 else ''}. "
            f"Choose another folder with -o, or use --force to replace the report in it"
        )
    return foreign


def _listed(folder: Path) -> dict[str, str]:
    """The files of an earlier report, with digests of their contents."""
    try:
        found = json.loads((folder / NUMBERS).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    files = found.get("files") if isinstance(found, dict) and found.get("written") == MARK else None
    return files if isinstance(files, dict) else {}


def write(data: dict[str, Any], folder: Path, force: bool = False) -> None:
    """Write all files of a report at once."""
    keep = refuse_foreign(folder, force)  # again: the folder may have changed during the measurements
    write_folder(folder, texts(data), keep)


def texts(data: dict[str, Any]) -> dict[str, str]:
    """The text of each file of a report, by name."""
    drawn = figures.figures(data)
    sections = tables(data)
    title = f"{data['model']}: speed against error"
    made = (
        f"ordernm {data['ordernm']}, {data['date']}; measured in {data['seconds']:.0f} s, with "
        f"{data['cpu_seconds']:.0f} s of CPU time. The numbers are in"
    )
    markdown = [f"# {title}", f"{made} [{NUMBERS}]({NUMBERS})."]
    for s in sections:
        pictures = (f"![{s.title}]({FIGURES}/{name}.svg)" for name in s.figures)
        markdown += [f"## {s.title}", *s.text, *pictures, *(part for t in s.tables for part in t.markdown())]
    found = {
        PAGE: page(title, f"{made} {NUMBERS}.", sections, drawn),
        MARKDOWN: "\n\n".join(markdown) + "\n",
        **{f"{FIGURES}/{name}.svg": svg + "\n" for name, svg in drawn.items()},
    }
    own = {"written": MARK, "files": {name: file_digest(text.encode()) for name, text in found.items()}}
    return found | {NUMBERS: json.dumps(_plain(data | own), indent=1, allow_nan=False) + "\n"}


def page(title: str, made: str, sections: list[Section], drawn: dict[str, str]) -> str:
    """A self-contained HTML page; `made` describes its origin, and `drawn` has the figures of the sections as SVG."""
    context = {"title": title, "made": made, "mark": MARK, "sections": sections, "drawn": drawn}
    return render("report/page.html.jinja", context)


def _plain(x: Any) -> Any:
    """Data with None in place of non-finite numbers, which JSON cannot represent."""
    if isinstance(x, dict):
        return {k: _plain(v) for k, v in x.items()}
    if isinstance(x, list | tuple):
        return [_plain(v) for v in x]
    return None if isinstance(x, float) and not math.isfinite(x) else x


def tables(data: dict[str, Any]) -> list[Section]:
    """Sections of a report: title, sentences, names of figures, tables."""
    sections = [_generated(data)]
    if "times" in data:
        sections += [_times(data), _roofline(data)]
    if data.get("errors"):
        sections.append(_errors(data))
    if data.get("differences"):
        sections.append(_differences(data["differences"]))
    if data.get("motions"):
        sections += _motions(data["motions"])
    if data["skipped"]:
        sections.append(Section("What was left out", [s["text"] for s in data["skipped"]]))
    return sections


def _generated(data: dict[str, Any]) -> Section:
    g, m = data["generated"], data["machine"]
    names = (
        "bodies", "links", "loops", "coordinates", "speeds", "freedoms", "parameters", "inputs", "outputs", "kinds", "layout",
        "code_lines", "code_bytes", "library_bytes",
    )  # fmt: skip
    note = "freedoms: independent speeds; kinds: groups of links, ears and regions of equal structure, which share code"
    sizes = Table("Sizes", ["", ""], [[n.replace("_", " "), str(g[n])] for n in names], note)
    stages = Table("Generation", ["stage", "time"], [[n, seconds(s)] for n, s in g["seconds"].items()])
    on = Table("Measured on", ["", ""], [[k, v] for k, v in m.items()])
    rows = []
    for name in ("accelerations", "sensitivities", "sensitivities_transposed"):
        for sweep, counts in g["operations"].get(name, {}).items():
            per_call, more = (sum(counts[k].values()) for k in ("per_call", "per_direction"))
            rows.append([name, sweep, str(per_call), str(more)])
    note = "additions, multiplications, divisions and functions, each counted as one"
    counted = Table("Operations", ["function", "sweep", "per call", "per direction"], rows, note)
    return Section("What was generated", g["choice"] + g["remarks"], (), [sizes, stages, on, counted])


def _times(data: dict[str, Any]) -> Section:
    t = data["times"]
    rows = []
    for name, x in t["functions"].items():
        c, call = x["compiled"], x["call"]
        shown = c["least"], c["median"], c["high"], call["least"], call["median"], call["high"]
        rows.append([name, *(seconds(s) for s in shown)])
    functions = Table(
        "Per evaluation",
        ["function", "in C, least", "median", "90 %", "one call from Python, least", "median", "90 %"],
        rows,
        "in C: per state of a batch in one thread. All functions took turns in "
        f"{processes.PROCESSES} processes one after another; times are CPU times of the thread, and 90 % of the turns took no "
        f"longer than the last column. Fixed work was timed before and after each turn; other processes on the machine slow "
        f"it down. In registers and the first cache it took {seconds(t['core']['least'])} at best, "
        f"{seconds(t['core']['median'])} in the median, and up to {seconds(t['core']['high'])} in 90 % of the turns; "
        f"on longer arrays {1e-9 / t['cache']['least']:.3g}, {1e-9 / t['cache']['median']:.3g} and "
        f"{1e-9 / t['cache']['high']:.3g} GB/s. "
        f"The ranges of two runs should overlap if both are widened by {agreement.SPREAD:.0%}, and by the square of the ratio by "
        f"which fixed work was slower. Run ordernm report --compare to check this.",
    )
    rows = [[n, seconds(x["least"]), seconds(x["median"])] for n, x in t["batches"].items()]
    batches = Table("Accelerations in batches", ["states", "per state, least", "median"], rows)
    return Section("Time per evaluation", [], ["times"], [functions, batches])


def _roofline(data: dict[str, Any]) -> Section:
    r = data["roofline"]
    rows = []
    for p in r["points"]:
        parts = [f"{100 * p['per_second'] / r['peaks'][peak]:.0f} %" for peak in ("vectors", "numbers")]
        rows.append([p["name"], str(p["operations"]), f"{p['per_second'] / 1e9:.2f}", number(p["per_byte"]), *parts])
    head = [
        "function",
        "operations",
        "GFlop/s",
        "operations per byte",
        "of the peak with vectors",
        "of the peak without vectors",
    ]
    text = [
        "Operations per second, compared with loops of multiply-adds and of sums that were measured in the same run."
    ]
    above = [p["name"] for p in r["points"] if p["per_second"] > r["peaks"]["vectors"]]
    if above:
        text.append(
            f"{', '.join(above)}: faster than the peak. Other work slowed the core down while it measured the peak; "
            "repeat the report on a quiet machine."
        )
    return Section("Roofline", text, ["roofline"], [Table("", head, rows)])


def _errors(data: dict[str, Any]) -> Section:
    conditions = {s["name"]: s["condition"] for s in data["states"]}
    rows, vanishing = [], set[str]()
    for e in data["errors"]:
        by, worst = max(e["derivatives"].items(), key=lambda item: item[1])
        vanishing.update(e["vanish"])
        figures_of = [number(x, 2) for x in (e["udot"], e["estimate"], worst, e["estimates"][by])]
        more = [number(e.get(name), 2) for name in ("jacobians", "gradient")]
        rows.append([e["state"], number(conditions[e["state"]]), *figures_of[:2], by, *figures_of[2:], *more])
    note = (
        "largest difference over largest entry, for each direction (Jacobians: the worst column); estimated: by "
        "solver.diagnose, without a reference; condition: of the closures, or of a tree's mass matrix"
    )
    if vanishing:
        note += (
            f"; derivatives with respect to {', '.join(sorted(vanishing))} vanish: their errors are relative to udot divided by "
            f"the parameter"
        )
    head = [
        "state",
        "condition",
        "udot",
        "estimated",
        "worst derivative by",
        "error",
        "estimated",
        "Jacobians",
        "gradient",
    ]
    text = "The generated C compared with the generic engine in 40 digits, both from the same double-precision states."
    return Section("Errors", [text], ["errors"], [Table("Relative errors", head, rows, note)])


def _differences(data: dict[str, Any]) -> Section:
    rows = [
        [f"{words} differences, best step", number(min((e for e in data[kind] if e is not None), default=None), 2)]
        for kind, words in (("forward", "one-sided"), ("central", "central"))
    ]
    rows.append(["exact, by the generated solver", number(data["exact"], 2)])
    text = [
        f"Derivative of the accelerations with respect to {data['by']}; the reference is {data['reference']}.",
        "Differences lose digits by truncation on the right and by rounding on the left; the exact derivative has no step.",
    ]
    return Section("Finite differences", text, ["differences"], [Table("", ["", "relative error"], rows)])


def _motions(data: dict[str, Any]) -> list[Section]:
    rows = []
    for method, points in data["methods"].items():
        for p in points:
            errors = [number(p[key], 2) for key in ("error", "sensitivity_error")]
            rows.append([method, number(p["setting"], 2), *errors, str(p["evaluations"]), seconds(p["seconds"])])
    by = f", with derivatives with respect to {', '.join(data['sensitivities'])}" if data["sensitivities"] else ""
    text = [
        f"{data['end']:g} s of motion{by}. The reference for errors at the end is {data['reference']}, with an error of about "
        f"{number(data['reference_error'], 2)}; grey: errors below that of the reference."
    ]
    if data["choices"] > 1:
        text.append(f"The motion passes dead points with {data['choices']} choices of independent coordinates.")
    if data["end"] < data["asked"]:
        text.append(
            f"Shorter than the requested {data['asked']:g} s" + (f": {data['ended']}." if "ended" in data else ".")
        )
    head = ["method", "tolerance or step", "error", "error of sensitivities", "evaluations", "time in C"]
    sections = [Section("Work and precision", text, ["work_precision"], [Table("", head, rows)])] if rows else []
    if data.get("conditions"):
        rows = [[k.replace("_", " "), number(max(v))] for k, v in data["conditions"].items() if k != "t"]
        sections.append(Section("Conditions along the motion", [], ["conditions"], [Table("", ["", "largest"], rows)]))
    return sections
