"""Trajectories: names, drifts, texts, tables, files equal bit by bit, and pictures."""

import builtins
import io
import json
import os
import pickle
import random
import re
import subprocess
import sys
import zipfile
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import codegen
from codegen.runtime import Event
from codegen.runtime.standalone.trajectory import files as trajectory_files
from codegen.runtime.standalone.trajectory import html as trajectory_html
from codegen.runtime.standalone.trajectory import plot as trajectory_plot
from codegen.runtime.standalone.trajectory.events import PARTS, Crossing
from codegen.runtime.standalone.trajectory.files import TrajectoryFileError
from codegen.runtime.standalone.trajectory.plot import PlotError
from codegen.runtime.standalone.trajectory.trajectory import (
    ARRAYS,
    FINISHED,
    INTERRUPTED,
    WORDS,
    Trajectory,
    UnknownNameError,
)

ROOT = Path(codegen.__file__).parents[1]
STATS = {"method": "dop853", "steps": 12, "evaluations": 144, "seconds": 0.0123, "reason": FINISHED}


def make(nt=51, by=("length", "mass"), noutputs=2, **changes) -> Trajectory:
    """A trajectory of a swinging crank and rod; no two arrays are equal."""
    t = np.linspace(0.0, 5.0, nt)
    k = len(by)
    series = [np.sin((i + 1) * t + 0.3 * i) * np.exp(-0.1 * t) for i in range(4 + noutputs)]
    slopes = [[(1 + d) * t * x + i for i, x in enumerate(series)] for d in range(k)]
    values = np.array(series).reshape(4 + noutputs, nt).T
    derivatives = np.array(slopes).reshape(k, 4 + noutputs, nt).transpose(0, 2, 1)
    given = {
        "coordinate_names": ("crank", "rod"), "speed_names": ("crank", "rod"),
        "output_names": tuple(f"tip_{x}" for x in range(noutputs)), "parameter_names": ("length", "mass"),
        "input_names": ("motor",), "sensitivity_names": by, "coordinate_units": ("rad", "rad"),
        "speed_units": ("rad/s", "rad/s"), "output_units": ("m", "N m s/rad", *("N",) * noutputs)[:noutputs],
        "parameter_units": ("m", "kg"), "p": [1.0, 2.0], "inputs": [0.5],
        "energy": np.column_stack([1 + np.cos(t), 2 - np.cos(t)]), "closure": 1e-13 * t, "stats": STATS,
    }  # fmt: skip
    return Trajectory(
        "linkage", t, values[:, :2], values[:, 2:4], derivatives[:, :, :2], derivatives[:, :, 2:4], values[:, 4:],
        derivatives[:, :, 4:], **(given | changes),
    )  # fmt: skip


# ---- series by name --------------------------------------------------------------------------------------------------


def test_series_have_the_names_of_expressions():
    x = make()
    assert x.names == ("q.crank", "q.rod", "u.crank", "u.rod", "tip_0", "tip_1") and len(x) == 51
    for names, array in (
        (("q.crank", "q.rod"), x.q), (("u.crank", "u.rod"), x.u), (("tip_0", "tip_1"), x.outputs)
    ):  # fmt: skip
        for i, name in enumerate(names):
            assert name in x
            np.testing.assert_array_equal(x[name], array[:, i])
    np.testing.assert_array_equal(x["t"], x.t)
    np.testing.assert_array_equal(x.q_of("rod"), x.q[:, 1])
    np.testing.assert_array_equal(x.u_of("crank"), x.u[:, 0])
    assert "crank" not in x and 3 not in x
    with pytest.raises(TypeError):
        iter(x)


def test_derivatives_by_name_and_number():
    x = make()
    for d, by in enumerate(("length", "mass")):
        for name, array in zip(x.names, np.concatenate([x.dq, x.du, x.doutputs], axis=2)[d].T, strict=True):
            np.testing.assert_array_equal(x.derivative(name, by), array)
            np.testing.assert_array_equal(x.derivative(name, d - 2), array)


@pytest.mark.parametrize(
    ("ask", "said"),
    [
        (lambda x: x["crank"], "did you mean 'q.crank' or 'u.crank'?"),
        (lambda x: x["q.crnk"], "did you mean 'q.crank'?"),
        (lambda x: x["crnk"], "did you mean 'q.crank' or 'u.crank'?"),
        (lambda x: x["tip0"], "did you mean 'tip_0'?"),
        (lambda x: x["zzz"], "there are t, q.crank, q.rod, u.crank, u.rod, tip_0, tip_1"),
        (lambda x: x[0], "trajectory.q[i] the coordinates at the i-th time"),
        (lambda x: x[1:2], "is not a name"),
        (lambda x: x.q_of("rd"), "did you mean 'q.rod'?"),
        (lambda x: x.u_of("x"), "no series 'u.x'"),
        (lambda x: x.derivative("tip", "length"), "no series 'tip'"),
        (lambda x: x.derivative("t", "length"), "no series 't'"),
        (
            lambda x: x.derivative("tip_0", "lenght"),
            "there are those for length, mass; did you mean 'length'?",
        ),
        (lambda x: x.derivative("tip_0", 2), "no derivative with respect to 2"),
        (lambda x: x.derivative("tip_0", -3), "no derivative with respect to -3"),
    ],
)
def test_unknown_names_are_told_with_the_nearest(ask, said):
    with pytest.raises(KeyError) as error:
        ask(make())
    assert isinstance(error.value, UnknownNameError) and said in str(error.value)
    assert not str(error.value).startswith(("'", '"'))


def test_derivatives_that_were_not_asked_for_say_how():
    with pytest.raises(KeyError, match=r"the simulation has none; ask for them.*sensitivities=\('mass',\)"):
        make(by=()).derivative("tip_0", "mass")


def test_units():
    x = make(by=("length", "mass", "q.crank", "wobble"))
    assert [x.unit(n) for n in ("t", "q.rod", "u.rod", "tip_1", "mass", "nothing")] == [
        "s", "rad", "rad/s", "N m s/rad", "kg", ""
    ]  # fmt: skip
    assert [x.derivative_unit("tip_0", by) for by in x.sensitivity_names] == ["m/m", "m/kg", "m/rad", ""]
    assert make(parameter_units=("m", "N m s/rad")).derivative_unit("q.rod", "mass") == "rad/(N m s/rad)"
    assert x.derivative_unit("u.rod", "length") == "(rad/s)/m"
    bare = make(coordinate_units=(), speed_units=(), output_units=(), parameter_units=())
    assert bare.unit("q.rod") == bare.derivative_unit("tip_0", "mass") == "" and bare.coordinate_units == ("", "")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"p": [1.0]}, r"p has shape \(1,\), expected \(2,\)"),
        ({"closure": np.zeros(3)}, r"closure has shape \(3,\), expected \(51,\)"),
        ({"energy": np.zeros((2, 51))}, r"energy has shape \(2, 51\), expected \(51, 2\)"),
        ({"coordinate_names": ("a",)}, r"q has shape \(51, 2\), expected \(51, 1\)"),
        ({"coordinate_units": ("m",)}, "1 coordinate units, expected 2"),
        ({"output_names": ("a", "a")}, "must differ"),
        ({"output_names": ("t", "a")}, "must differ from each other and from t"),
        ({"output_names": ("q.rod", "a")}, "must differ"),
        ({"sensitivity_names": ("a", "a")}, "sensitivities must differ"),
        ({"stats": {"reason": {1: object()}}}, r"stats\['reason'\]\['?1'?\] is <object"),
    ],
)
def test_what_does_not_fit_together_is_told(changes, said):
    with pytest.raises(ValueError, match=said):
        make(**changes)


def test_what_is_left_out():
    t = np.linspace(0, 1, 3)
    names = {"coordinate_names": ("a",), "speed_names": ("a",)}
    x = Trajectory("m", t, t[:, None], t[:, None], **names)
    assert x.dq.shape == (0, 3, 1) and x.outputs.shape == (3, 0) and x.doutputs.shape == (0, 3, 0)
    assert x.p is x.inputs is x.energy is x.closure is x.energy_drift is x.closure_drift is None
    assert x.ended == "unknown" and "ended: unknown" in repr(x)
    with pytest.raises(ValueError, match=r"dq is missing; give an array of shape \(1, 3, 1\)"):
        Trajectory("m", t, t[:, None], t[:, None], sensitivity_names=("p",), **names)
    with pytest.raises(ValueError, match="outputs is missing"):
        Trajectory("m", t, t[:, None], t[:, None], output_names=("x",), **names)


# ---- how it went -----------------------------------------------------------------------------------------------------


def test_the_last_state_is_a_copy():
    x = make()
    q, u = x.final
    np.testing.assert_array_equal(q, x.q[-1])
    np.testing.assert_array_equal(u, x.u[-1])
    q[0] = 7.0
    assert x.q[-1, 0] != 7.0
    with pytest.raises(IndexError, match="no times"):
        _ = make(nt=0).final


def test_drifts():
    t = np.linspace(0.0, 1.0, 5)
    kinetic = np.array([0.0, 1.0, 2.0, 1.0, 0.0])
    for zero in (0.0, -1e3, 2.0):  # where potential energy is zero does not matter
        energy = np.column_stack([kinetic, zero - kinetic + 0.02 * np.sin(np.pi * t)])
        assert make(nt=5, energy=energy).energy_drift == pytest.approx(0.01, rel=1e-9)
    assert make(nt=5, energy=np.ones((5, 2)) * [0, 3]).energy_drift == 0.0
    assert np.isnan(make(nt=5, energy=np.full((5, 2), np.nan)).energy_drift)
    assert make(nt=5, closure=[0, 3e-9, 1e-9, 0, 0]).closure_drift == 3e-9
    assert make(nt=0).energy_drift == make(nt=0).closure_drift == 0.0


def test_what_is_computed_when_it_is_asked_for():
    asked = []

    def later(name, value):
        def compute():
            asked.append(name)
            return value

        return compute

    x = make(nt=2, energy=later("energy", [[1.0, 2.0], [1.5, 1.5]]), closure=later("closure", [0.0, 2e-9]))
    assert not asked
    assert x.closure_drift == x.closure.max() == 2e-9 and asked == ["closure"]
    assert pickle.loads(pickle.dumps(x)).energy.tolist() == [[1.0, 2.0], [1.5, 1.5]]
    assert x.energy_drift == 0.0 and asked == ["closure", "energy"]
    with pytest.raises(ValueError, match=r"energy has shape \(2,\), expected \(2, 2\)"):
        _ = make(nt=2, energy=lambda: [1.0, 2.0]).energy


def test_what_it_shows():
    assert repr(make()).splitlines() == [
        "Trajectory of linkage: 51 times from 0 to 5 s",
        "  2 coordinates, 2 speeds, 2 outputs, derivatives with respect to length, mass",
        "  dop853: 12 steps, 144 evaluations, 0.0123 s, ended: finished",
        "  total energy changes by 0 at most, loops are open by 5e-13 at most",
    ]
    assert repr(make(energy=np.linspace([1.0, 2.0], [1.0, 2.5], 51))).splitlines()[3:] == [
        "  total energy changes by 0.5 at most, loops are open by 5e-13 at most",
        "  (relative to the energy that is exchanged; joint forces, friction and inputs change the total energy, too)",
    ]
    short = repr(make(nt=1, by=(), noutputs=0, energy=None, closure=None, stats={"reason": INTERRUPTED}))
    assert short.splitlines() == [
        "Trajectory of linkage: 1 time from 0 to 0 s", "  2 coordinates, 2 speeds", "  ended: interrupted"
    ]  # fmt: skip
    assert "0 times\n" in repr(make(nt=0))


class Checked(HTMLParser):
    """An HTML parser that fails if tags are not nested."""

    def __init__(self):
        super().__init__()
        self.open, self.seen = [], []

    def handle_starttag(self, tag, attrs):
        self.seen.append(tag)
        if tag != "br" and not self.get_starttag_text().endswith("/>"):
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.seen.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def parsed(text: str) -> list[str]:
    checked = Checked()
    checked.feed(text)
    assert not checked.open
    return checked.seen


def test_notebooks_get_a_table_with_curves():
    text = make()._repr_html_()
    tags = parsed(text)
    assert (
        tags.count("svg") == 2 and tags.count("polyline") == 2 and "tip_1" in text and "Trajectory of linkage" in text
    )
    assert parsed(make(noutputs=0)._repr_html_()).count("svg") == 4  # coordinates and speeds
    many = make(noutputs=40)._repr_html_()
    assert parsed(many).count("svg") == trajectory_html.SHOWN and f"and {40 - trajectory_html.SHOWN} more" in many
    assert parsed(make(nt=0)._repr_html_()).count("polyline") == 0


def test_names_are_escaped():
    evil = "<script>alert(1)</script>&"
    text = make(output_names=(evil, "b"), output_units=("<b>", "m"))._repr_html_()
    assert "<script" not in text and "<b>" not in text and "&lt;script&gt;" in text
    parsed(text)


def test_curves_keep_peaks_and_gaps():
    t = np.linspace(0.0, 1.0, 100_001)
    values = np.zeros(len(t))
    values[12_345] = 1.0
    picture = trajectory_html.sparkline(t, values)
    assert len(picture) < 5000 and f",{trajectory_html.MARGIN:.1f} " in picture
    values[50_000:60_000] = np.nan
    values[70_000] = np.inf
    assert trajectory_html.sparkline(t, values).count("polyline") == 3
    huge = trajectory_html.sparkline(np.array([0.0, 1.0]), np.array([-1.7e308, 1.7e308]))
    assert "nan" not in huge and "inf" not in huge
    assert trajectory_html.sparkline(t[:1], values[:1]).count("circle") == 1


# ---- tables ----------------------------------------------------------------------------------------------------------


def test_a_table_of_pandas():
    pandas = pytest.importorskip("pandas", reason="to_dataframe needs pandas")
    x = make()
    table = x.to_dataframe()
    assert table.index.name == "t" and table.shape == (51, 18)
    assert list(table.columns[:7]) == [*x.names, "d(q.crank)/d(length)"]
    np.testing.assert_array_equal(table.index, x.t)
    np.testing.assert_array_equal(table["tip_1"], x["tip_1"])
    np.testing.assert_array_equal(table["d(u.rod)/d(mass)"], x.derivative("u.rod", "mass"))
    assert (table.dtypes == np.float64).all()
    assert make(nt=0).to_dataframe().shape == (0, 18) and isinstance(table, pandas.DataFrame)


# ---- files -----------------------------------------------------------------------------------------------------------


def same_bits(a: Trajectory, b: Trajectory) -> None:
    for name in WORDS:
        # JSON tells NaN from NaN alike
        assert json.dumps(getattr(a, name)) == json.dumps(getattr(b, name)), name
        assert type(getattr(a, name)) is type(getattr(b, name)), name
    for name in ARRAYS:
        x, y = getattr(a, name), getattr(b, name)
        assert (x is None) == (y is None), name
        if x is not None:
            assert x.shape == y.shape and x.dtype == y.dtype == np.float64, name
            assert x.tobytes() == y.tobytes(), name
    assert [(c.event, c.t) for c in a.events] == [(c.event, c.t) for c in b.events]
    for one, other in zip(a.events, b.events, strict=True):
        for name in PARTS:
            assert getattr(one, name).shape == getattr(other, name).shape, name
            assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name


def odd() -> Trajectory:
    """Numbers that may be lost in files: several NaNs, infinities, negative zero, the smallest and the largest number."""
    names = {"coordinate_names": ("größe", "角 度"), "output_names": ("тело", "a\nb\"'\\"), "parameter_names": ("ℓ", "mass"),
             "sensitivity_names": ("ℓ", "mass"), "p": [-0.0, 0.1 + 0.2]}  # fmt: skip
    stats = STATS | {"nan": np.nan, "list": (1, 2.5, None), "flag": np.bool_(True), "deep": {"α": np.float64(1e-320)}}
    x = make(**names, stats=stats)
    bits = np.array([0x7FF8000000000001, 0xFFF8000000000000, 0x7FF0000000000000, 0x8000000000000000, 1], np.uint64)
    for array in (x.q, x.u, x.outputs, x.dq[1], x.doutputs[0], x.energy):
        array[3:8, 0] = bits.view(np.float64)
    x.closure[:5] = bits.view(np.float64)
    return x


def stopped() -> Trajectory:
    """A trajectory with two events, one of which only touches its level."""
    x = make()
    nq, nu, no, k = (x.q.shape[1], x.u.shape[1], x.outputs.shape[1], len(x.dq))
    rng = np.random.default_rng(5)
    shapes = [(nq,), (nu,), (no,), (no,), (k,), (k, nq), (k, nu), (k, no)]
    crossings = [[rng.normal(size=shape) for shape in shapes] for _ in range(2)]
    for part in crossings[1][4:]:
        part[...] = np.frombuffer(np.uint64(0xFFF8000000000001).tobytes())
    events = Event(x.output_names[0], 0.1 + 0.2, "down", False), Event(x.output_names[1])
    x.events = tuple(
        Crossing(e, 0.1 * i, *parts[:4], 2.5 + i, *parts[4:])
        for i, (e, parts) in enumerate(zip(events, crossings, strict=True))
    )
    return x


TRAJECTORIES = {
    "plain": make,
    "events": stopped,
    "odd": odd,
    "no derivatives": lambda: make(by=()),
    "no outputs": lambda: make(noutputs=0),
    "one time": lambda: make(nt=1),
    "no times": lambda: make(nt=0),
    "nothing optional": lambda: make(p=None, inputs=None, energy=None, closure=None, stats={}),
    "nothing that moves": lambda: Trajectory("still", [0.0, 1.0], np.zeros((2, 0)), np.zeros((2, 0)), coordinate_names=(),
                                             speed_names=()),
}  # fmt: skip


@pytest.fixture(params=[".npz", ".parquet"])
def suffix(request):
    if request.param == ".parquet":
        pytest.importorskip("pyarrow", reason="Parquet files need pyarrow")
    return request.param


@pytest.mark.parametrize("which", TRAJECTORIES)
def test_files_give_every_bit_back(tmp_path, suffix, which):
    x = TRAJECTORIES[which]()
    path = tmp_path / f"Läufe 1{suffix.upper() if which == 'plain' else suffix}"
    x.save(path)
    same_bits(x, Trajectory.load(path))
    same_bits(x, codegen.load_trajectory(str(path)))
    first = path.read_bytes()
    Trajectory.load(path).save(path)
    assert path.read_bytes() == first  # same input, same bytes
    assert os.listdir(tmp_path) == [path.name]


def test_an_npz_needs_no_pickle_and_no_ordernm(tmp_path):
    x = make()
    x.save(tmp_path / "run.npz")
    with np.load(tmp_path / "run.npz", allow_pickle=False) as archive:
        np.testing.assert_array_equal(archive["doutputs"], x.doutputs)
        assert json.loads(archive["header"].tobytes())["coordinate_names"] == ["crank", "rod"]


def test_a_parquet_file_is_a_table(tmp_path):
    pytest.importorskip("pyarrow", reason="Parquet files need pyarrow")
    pandas = pytest.importorskip("pandas", reason="reads the table")
    x = make()
    x.save(tmp_path / "run.parquet")
    table = pandas.read_parquet(tmp_path / "run.parquet")
    np.testing.assert_array_equal(table["d(tip_0)/d(mass)"], x.derivative("tip_0", "mass"))
    np.testing.assert_array_equal(table["t"], x.t)
    assert {"energy.kinetic", "energy.potential", "loops.closure"} < set(table.columns)


@pytest.mark.parametrize(
    ("name", "seen"), [("run.csv", "ends in .csv"), ("run", "has no suffix"), ("x.npz.gz", "in .gz")]
)
def test_other_suffixes_are_told(tmp_path, name, seen):
    for act in (make().save, Trajectory.load):
        with pytest.raises(TrajectoryFileError, match=rf"{seen}; trajectories are kept in files .npz or .parquet"):
            act(tmp_path / name)
    assert not os.listdir(tmp_path)


def test_files_that_cannot_be(tmp_path, suffix):
    with pytest.raises(FileNotFoundError):
        Trajectory.load(tmp_path / f"no{suffix}")
    with pytest.raises(FileNotFoundError) as error:
        make().save(tmp_path / "nowhere" / f"run{suffix}")
    assert error.value.filename == str(tmp_path / "nowhere" / f"run{suffix}")  # not the name beside it
    (tmp_path / f"folder{suffix}").mkdir()
    with pytest.raises(OSError):
        make().save(tmp_path / f"folder{suffix}")
    with pytest.raises(OSError):
        Trajectory.load(tmp_path / f"folder{suffix}")
    assert os.listdir(tmp_path) == [f"folder{suffix}"]


def test_a_failure_leaves_the_file_that_was_there(tmp_path, suffix, monkeypatch):
    path = tmp_path / f"run{suffix}"
    make().save(path)
    before = path.read_bytes()

    def fail(*paths):
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(KeyboardInterrupt):
        make(nt=3).save(path)
    assert path.read_bytes() == before and os.listdir(tmp_path) == [path.name]


def test_a_link_to_a_file_stays_one(tmp_path, suffix):
    (tmp_path / f"link{suffix}").symlink_to(tmp_path / f"run{suffix}")
    make().save(tmp_path / f"link{suffix}")
    assert (tmp_path / f"link{suffix}").is_symlink() and (tmp_path / f"run{suffix}").is_file()


def test_damaged_files_are_told(tmp_path, suffix):
    """Cut short anywhere, or with any byte changed, a file is refused, or gives the very same trajectory."""
    whole, path = make(nt=5), tmp_path / f"run{suffix}"
    whole.save(path)
    content = path.read_bytes()
    for size in (0, 1, 10, len(content) // 2, len(content) - 1):
        path.write_bytes(content[:size])
        with pytest.raises(TrajectoryFileError, match=r"is damaged or was changed.*save the trajectory again"):
            Trajectory.load(path)
    refused = 0
    for at in range(0, len(content), max(1, len(content) // 150)):
        path.write_bytes(content[:at] + bytes([content[at] ^ 0x10]) + content[at + 1 :])
        try:
            found = Trajectory.load(path)
        except TrajectoryFileError as error:
            refused += 1
            assert str(error).count("\n") == 0 and str(path) in str(error)
        else:
            same_bits(whole, found)
    assert refused > 50


def test_other_files_are_told(tmp_path):
    np.savez(tmp_path / "mine.npz", x=np.zeros(3))
    with pytest.raises(TrajectoryFileError, match=r"mine.npz contains no trajectory: it is another NumPy file"):
        Trajectory.load(tmp_path / "mine.npz")
    with open(tmp_path / "array.npz", "wb") as file:
        np.save(file, np.zeros(3))
    with pytest.raises(TrajectoryFileError, match="contains no trajectory"):
        Trajectory.load(tmp_path / "array.npz")
    np.savez(tmp_path / "objects.npz", header=np.array([{"a": 1}], dtype=object))
    with pytest.raises(TrajectoryFileError, match="damaged"):
        Trajectory.load(tmp_path / "objects.npz")


def test_another_table_of_parquets_is_told(tmp_path):
    arrow = pytest.importorskip("pyarrow", reason="Parquet files need pyarrow")
    import pyarrow.parquet

    pyarrow.parquet.write_table(arrow.table({"x": [1, 2]}), tmp_path / "mine.parquet")
    with pytest.raises(TrajectoryFileError, match=r"mine.parquet contains no trajectory: it is another Parquet file"):
        Trajectory.load(tmp_path / "mine.parquet")


def with_header(path: Path, **changes) -> None:
    """An ``.npz`` file with a changed header."""
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    header = json.loads(arrays["header"].tobytes()) | changes
    arrays["header"] = np.frombuffer(json.dumps(header).encode(), np.uint8)
    np.savez(path, **arrays)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"version": 2}, "is of version 2 of the format, this ordernm reads version 1"),
        ({"format": "recipes"}, "contains no trajectory: its format is 'recipes'"),
        ({"coordinate_names": ["crank", "rode"]}, "not those that were saved"),
    ],
)
def test_headers_are_read_with_care(tmp_path, changes, said):
    make().save(tmp_path / "run.npz")
    with_header(tmp_path / "run.npz", **changes)
    with pytest.raises(TrajectoryFileError, match=said):
        Trajectory.load(tmp_path / "run.npz")


def test_files_of_another_make_may_lack_something(tmp_path, monkeypatch):
    monkeypatch.setattr(trajectory_files, "_digest", lambda words, arrays: "same")
    make().save(tmp_path / "run.npz")
    with_header(tmp_path / "run.npz", surplus=1)
    with pytest.raises(TrajectoryFileError, match="surplus"):
        Trajectory.load(tmp_path / "run.npz")
    make().save(tmp_path / "run.npz")
    with_header(tmp_path / "run.npz", coordinate_names=["crank"])
    with pytest.raises(TrajectoryFileError, match=r"q has shape"):
        Trajectory.load(tmp_path / "run.npz")


def test_permissions_are_those_of_other_files(tmp_path):
    make().save(tmp_path / "run.npz")
    (tmp_path / "other").write_text("")
    assert (tmp_path / "run.npz").stat().st_mode == (tmp_path / "other").stat().st_mode


# ---- pictures --------------------------------------------------------------------------------------------------------


@pytest.fixture
def plotting():
    pytest.importorskip("matplotlib", reason="plots need matplotlib")


def labels(figure) -> list[str]:
    return [a.get_title(loc="left") for a in figure.axes if a.axison]


def test_outputs_with_their_derivatives(plotting):
    figure = make().plot()
    assert labels(figure) == [
        "tip_0 (m)", "derivatives of tip_0 with respect to", "tip_1 (N m s/rad)", "derivatives of tip_1 with respect to"
    ]  # fmt: skip
    value, derivatives = figure.axes[:2]
    np.testing.assert_array_equal(value.lines[0].get_ydata(), make()["tip_0"])
    assert [text.get_text() for text in derivatives.get_legend().get_texts()] == ["length (m/m)", "mass (m/kg)"]
    styles = [(line.get_linestyle(), line._dash_pattern) for line in derivatives.lines]
    assert len(set(map(str, styles))) == 2  # told apart without colour
    assert [a.get_xlabel() for a in figure.axes] == ["", "", "t (s)", "t (s)"]


def test_what_is_plotted_can_be_chosen(plotting):
    assert labels(make(noutputs=0, by=()).plot()) == ["q.crank (rad)", "q.rod (rad)"]
    assert labels(make().plot("u.rod", sensitivities=())) == ["u.rod (rad/s)"]
    one = make().plot(["tip_0", "q.rod"], sensitivities="mass")
    assert labels(one) == ["tip_0 (m)", "d tip_0 / d mass (m/kg)", "q.rod (rad)", "d q.rod / d mass (rad/kg)"]
    np.testing.assert_array_equal(one.axes[1].lines[0].get_ydata(), make().derivative("tip_0", "mass"))
    assert labels(make(output_units=()).plot(sensitivities=())) == ["tip_0", "tip_1"]
    with pytest.raises(KeyError, match="did you mean 'tip_0'"):
        make().plot("tip0")
    with pytest.raises(KeyError, match="did you mean 'mass'"):
        make().plot(sensitivities=["mas"])
    with pytest.raises(PlotError, match="nothing to plot"):
        make().plot([])


def test_small_curves_are_raised_by_powers_of_ten_that_are_told(plotting):
    x = make(by=("length", "mass"))
    x.doutputs[1] *= 1e-5
    x.doutputs[0, :, 1] = 0.0
    figure = x.plot()
    first, second = figure.axes[1], figure.axes[3]
    legend = [text.get_text() for text in first.get_legend().get_texts()]
    assert legend[0] == "length (m/m)"
    factor = float(re.fullmatch(r"mass × (\w+) \(m/kg\)", legend[1])[1])
    assert factor in (1e4, 1e5)
    np.testing.assert_allclose(first.lines[1].get_ydata(), x.doutputs[1, :, 0] * factor, rtol=1e-14)
    assert "× " not in "".join(t.get_text() for t in second.get_legend().get_texts())  # zero stays zero


def test_rounding_is_drawn_flat(plotting):
    x = make(by=())
    x.outputs[:, 0] = 3.0 + 1e-15 * np.sin(x.t)
    x.outputs[:, 1] = 0.0
    a, b = make(by=()).plot().axes, x.plot().axes
    assert np.ptp(a[0].get_ylim()) < 3 and b[0].get_ylim() == pytest.approx((1.5, 4.5)) and np.ptp(b[1].get_ylim()) > 1


def test_many_series_are_cut_when_nobody_chose_them(plotting):
    many = make(noutputs=100, by=())
    figure = many.plot()
    assert len(labels(figure)) == trajectory_plot.CUT and "the first 24 of 100 series" in figure._suptitle.get_text()
    with pytest.raises(PlotError, match="100 series are too many for a picture, 60 are allowed"):
        many.plot(many.output_names)
    x = make(by=tuple(f"p{i}" for i in range(11)), noutputs=1)
    figure = x.plot()
    assert len(figure.axes[1].lines) == trajectory_plot.MOST_CURVES and "first 8 of 11" in figure._suptitle.get_text()


@pytest.mark.parametrize("kind", [".svg", ".png", ".pdf", ".SVG"])
def test_pictures_are_the_same_bytes_twice(plotting, tmp_path, kind):
    import matplotlib

    make().plot(path=tmp_path / f"a{kind}")
    with matplotlib.rc_context({"lines.linewidth": 9, "font.size": 30, "svg.hashsalt": None, "text.usetex": True}):
        before = dict(matplotlib.rcParams)
        odd_settings = make().plot(path=tmp_path / f"b{kind}")
        assert dict(matplotlib.rcParams) == before  # and nobody's settings are changed
    first, second = ((tmp_path / f"{name}{kind}").read_bytes() for name in "ab")
    assert first == second and len(first) > 5000 and odd_settings is not None
    starts = {".svg": b"<?xml", ".png": b"\x89PNG", ".pdf": b"%PDF"}
    assert first.startswith(starts[kind.lower()])
    assert sorted(os.listdir(tmp_path)) == [f"a{kind}", f"b{kind}"]


@pytest.mark.parametrize(("name", "seen"), [("out.jpg", "ends in .jpg"), ("out", "has no suffix")])
def test_other_pictures_are_told(plotting, tmp_path, name, seen):
    with pytest.raises(PlotError, match=f"{seen}; pictures are written as .svg, .png, .pdf"):
        make().plot(path=tmp_path / name)


@pytest.mark.filterwarnings("error:.*:RuntimeWarning")
def test_odd_numbers_and_names_are_drawn(plotting, tmp_path):
    x = make(output_names=("$broken", "_hidden"), stats={"reason": INTERRUPTED})
    x.outputs[3:5] = [[np.nan, np.inf], [-np.inf, 1e300]]
    x.doutputs[0] = np.nan
    figure = x.plot(path=tmp_path / "a.svg")
    assert labels(figure)[0] == "$broken (m)" and figure._suptitle.get_text() == "linkage (interrupted)"
    for nt in (0, 1, 2):
        make(nt=nt).plot(path=tmp_path / f"{nt}.png")


def test_no_window_is_opened(tmp_path):
    pytest.importorskip("matplotlib", reason="plots need matplotlib")
    script = (
        "import sys, numpy as np\nfrom codegen.runtime import Trajectory\n"
        "x = Trajectory('m', [0, 1], [[0], [1]], [[0], [1]], coordinate_names=['a'], speed_names=['a'])\n"
        "late = [m for m in ('matplotlib', 'pandas', 'pyarrow') if m in sys.modules]\n"
        "x.plot(path='a.svg')\nprint(late, 'matplotlib.pyplot' in sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)},
                         capture_output=True, text=True, check=False)  # fmt: skip
    assert run.stdout == "[] False\n", run.stderr


# ---- what is not installed -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("module", "extra", "act"),
    [
        ("pandas", "dataframe", lambda x, folder: x.to_dataframe()),
        ("matplotlib", "plot", lambda x, folder: x.plot()),
        ("pyarrow", "parquet", lambda x, folder: x.save(folder / "x.parquet")),
        ("pyarrow", "parquet", lambda x, folder: Trajectory.load(folder / "x.parquet")),
    ],
)
def test_what_to_install_is_told(monkeypatch, tmp_path, module, extra, act):
    def without(name, *arguments, load=builtins.__import__):
        if name.partition(".")[0] == module:
            raise ImportError(f"No module named {name!r}", name=name)
        return load(name, *arguments)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(ImportError, match=rf'pip install "ordernm\[{extra}\]", or pip install {module}'):
        act(make(), tmp_path)
    monkeypatch.undo()
    assert f"\n{extra} = " in (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    assert not os.listdir(tmp_path)


def test_an_npz_is_one_of_zip(tmp_path):
    make().save(tmp_path / "run.npz")
    assert zipfile.is_zipfile(tmp_path / "run.npz")


SIZES = {
    (10**11,): "100000000000",
    (2**62, 2**62): "needs",
    (3,): "damaged",
    (-1,): "damaged",
    (10**9, 1): "8000000000 bytes",
}


@pytest.mark.parametrize("shape", SIZES)
def test_shapes_that_are_not_there_take_no_memory(tmp_path, shape):
    """An array of a few bytes whose header tells of 800 GB."""
    make().save(tmp_path / "run.npz")
    with zipfile.ZipFile(tmp_path / "run.npz") as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    text = io.BytesIO()
    np.lib.format.write_array_header_1_0(text, {"descr": "<f8", "fortran_order": False, "shape": shape})
    members["q.npy"] = text.getvalue() + bytes(80)
    with zipfile.ZipFile(tmp_path / "run.npz", "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    with pytest.raises(
        TrajectoryFileError, match=rf"is damaged or was changed: .*{SIZES[shape] if shape[0] > 3 else ''}"
    ):
        Trajectory.load(tmp_path / "run.npz")


def test_a_deep_header_is_damage(tmp_path):
    make().save(tmp_path / "run.npz")
    with np.load(tmp_path / "run.npz") as archive:
        arrays = {name: archive[name] for name in archive.files}
    for text in (b"[" * 200000, b'{"format": ' + b"[" * 200000, b"9" * 10000):
        np.savez(tmp_path / "run.npz", **arrays | {"header": np.frombuffer(text, np.uint8)})
        with pytest.raises(TrajectoryFileError, match="is damaged or was changed: its header cannot be read"):
            Trajectory.load(tmp_path / "run.npz")


@pytest.mark.campaign
def test_files_damaged_in_many_places(tmp_path, suffix):
    """Seed 2: bytes changed, left out and cut off; a trajectory comes back, or the one error."""
    make(nt=5).save(tmp_path / f"run{suffix}")
    content, rng, refused = (tmp_path / f"run{suffix}").read_bytes(), random.Random(2), 0
    for _ in range(3000):
        damaged = bytearray(content)
        for _ in range(rng.randint(1, 4)):
            i, kind = rng.randrange(len(damaged)), rng.random()
            if kind < 0.6:
                damaged[i] = rng.randrange(256)
            elif kind < 0.8:
                del damaged[i : i + rng.randint(1, 30)]
            else:
                del damaged[i + 1 :]
        (tmp_path / f"run{suffix}").write_bytes(damaged)
        try:
            Trajectory.load(tmp_path / f"run{suffix}")
        except TrajectoryFileError:
            refused += 1
    assert refused > 2000
