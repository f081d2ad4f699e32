"""In a notebook, views, pages and results display themselves, and nothing else is printed."""

import pytest

pytestmark = pytest.mark.campaign

CELLS = """
import ordernm, urllib.request
ordernm.generate(r"MODEL", "made", target="numpy", frames=True, check=False)
#
solver = ordernm.load("made", target="numpy")
view = solver.view()
view
#
assert b"<html" in urllib.request.urlopen(view.url).read(10_000)
#
run = ordernm.Trajectory("swing", [0.0, 0.1], [[0.0], [0.1]], [[0.0], [0.0]], coordinate_names=solver.coordinate_names,
                         speed_names=solver.speed_names, parameter_names=solver.parameter_names)
playing = run.view(solver)
playing
#
run.html("run.html", solver)
open("run.html").read(15)
#
solver.picture(solver.initial[0])
#
run
#
view.close()
playing.close()
"""
MODEL = """
model: swing
gravity: [0, 0, -9.81]
bodies:
  rod: {parent: ground, joint: {type: revolute, axis: y}, mass: 1, com: [0, 0, -1]}
"""
EXPECTED = [
    ["text/html", "text/plain"], ["text/html", "text/plain"], [], ["text/html", "text/plain"], ["text/plain"],
    ["image/png", "text/plain"], ["text/html", "text/plain"], [],
]  # fmt: skip


def test_everything_shows_itself(tmp_path):
    nbclient = pytest.importorskip("nbclient", reason="runs notebooks: pip install nbclient ipykernel")
    nbformat = pytest.importorskip("nbformat")
    for extra in ("ipykernel", "viser", "matplotlib"):
        pytest.importorskip(extra)
    (tmp_path / "swing.yaml").write_text(MODEL)
    cells = CELLS.replace("MODEL", str(tmp_path / "swing.yaml")).split("#\n")
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(x) for x in cells])
    resources = {"metadata": {"path": str(tmp_path)}}
    nbclient.NotebookClient(notebook, timeout=300, resources=resources).execute()
    streams = [o.text for c in notebook.cells for o in c.outputs if o.output_type == "stream"]
    assert streams == []
    found = [[sorted(o.data) for o in c.outputs if o.data != {"text/plain": ""}] for c in notebook.cells]
    assert found == [[x] if x else [] for x in EXPECTED]
    assert "<iframe" in notebook.cells[1].outputs[0].data["text/html"]
