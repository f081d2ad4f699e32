"""Makes a checked `Model` from the plain data of a file or of the builder, and collects all errors.

The sections are read once, in the order in which they depend on each other: constants, parameters, inputs, gravity, bodies,
visuals of the ground, prescribed motion, points, loops, couplings, forces, outputs, initial values, independent coordinates. A
section with errors is reported and left out, so that the others are still checked.
"""

from __future__ import annotations

from .entries import shown
from .errors import ModelError, Problem
from .forces import JointForce
from .model import GROUND, Model
from .positions import Document, digest_of_documents
from .problems import TooManyProblems
from .reading import Reader
from .repetition import CannotGoOn
from .schema import SECTIONS
from .sections.bodies import check_freedoms, read_bodies
from .sections.couplings import read_couplings
from .sections.elements import read_forces, read_outputs
from .sections.files import check_given, read_files
from .sections.gravity import is_constant, read_gravity, weights
from .sections.independent import read_independent
from .sections.initial import is_at_rest, read_initial
from .sections.loops import read_loop_tolerance, read_loops
from .sections.motion import read_motion
from .sections.named_expressions import check_named_expressions, read_named_expressions, warn_of_unused
from .sections.points import read_points
from .sections.quantities import model_name, read_inputs, read_parameters, warn_of_unused_quantities
from .sections.tables import read_tables
from .sections.visuals import read_visuals_of_ground


def assemble(document: Document, folder: str | None = None) -> Model:
    """The model that a document describes; `folder` contains the other files that it names.

    Raises
    ------
    ModelError
        If the document has errors. The exception lists all of them.
    """
    reader = Reader(document, folder)
    model = None
    try:
        model = _model(reader) if _is_mapping(document, reader) else None
    except (TooManyProblems, CannotGoOn):
        pass
    except RecursionError:  # limits on depth should prevent it, but the caller's stack may already be deep
        reader.problems.append(Problem(document.file, 1, 1, "", "expressions nested too deeply"))
    errors = [p for p in reader.problems if p.severity == "error"]
    if errors or model is None:
        files = list(dict.fromkeys([document.file, *(p.file for p in errors)]))
        order = sorted(errors, key=lambda p: (files.index(p.file), p.line or 0, p.column or 0))
        raise ModelError([*order, *(p for p in reader.problems if p.severity != "error")])
    return model


def _is_mapping(document: Document, reader: Reader) -> bool:
    """Whether a document has keys; reports an error if not."""
    if isinstance(document.root, dict):
        return True
    message = f"{shown(document.root)}; a model file is a mapping with the keys {', '.join(SECTIONS)}"
    start = None if document.file == "builder" else 1
    reader.add(Problem(document.file, start, start, "", message))
    return False


def _model(reader: Reader) -> Model | None:
    name = model_name(reader)
    read_files(reader)
    parameters = read_parameters(reader)
    reader.allowed["inputs"] = {**dict.fromkeys(reader.defaults), "t": None}
    read_inputs(reader)
    reader.allowed["inputs"]["t"] = reader.allowed["inputs"].pop("t")  # the name t comes last in messages
    check_given(reader)
    tables = read_tables(reader)
    named = read_named_expressions(reader)
    reader.allowed["motion"] = dict(reader.allowed["inputs"])  # moving coordinates are added when the bodies are read
    gravity = read_gravity(reader)
    bodies = read_bodies(reader)
    visuals, motion = read_visuals_of_ground(reader, bodies.bodies), read_motion(reader, bodies)
    points = read_points(reader, bodies)
    reader.points = [points, bodies.frames]
    check_named_expressions(reader, named)
    before = reader.errors
    loops = read_loops(reader, bodies, points)
    couplings = read_couplings(reader, bodies)
    if reader.errors == before:  # a body may seem to move no mass if its loop cannot be read
        faces = [face for loop in loops for face in (loop.start, loop.end)]
        coupled = {term.body for of in couplings for term in of.terms}
        check_freedoms(reader, bodies, {face.body for face in faces if face.body != GROUND} | coupled, motion)
    elements = read_forces(reader, bodies, points)
    if gravity is not None and not is_constant(reader, gravity):
        elements += weights(gravity, bodies) if bodies.is_sound else []
        gravity = None
    outputs = read_outputs(reader, bodies, points)
    initial, independent = read_initial(reader, bodies), read_independent(reader, bodies)
    loop_tolerance = read_loop_tolerance(reader)
    warn_of_unused(reader, "expression", (at for at, _ in named))
    warn_of_unused(reader, "table", tables)
    if any(p.severity == "error" for p in reader.problems):
        return None
    warn_of_unused_quantities(reader, parameters)
    return Model(
        name=name,
        gravity=gravity,
        parameters=tuple(p for p, _ in parameters),
        inputs=tuple(reader.inputs),
        bodies=tuple(bodies.bodies),
        loops=(*loops, *couplings),
        forces=tuple(e for e in elements if isinstance(e, JointForce)),
        loads=tuple(e for e in elements if not isinstance(e, JointForce)),
        outputs=tuple(outputs),
        motion=motion,
        initial_q=initial["q"],
        initial_u=initial["u"],
        initial_at_rest=is_at_rest(reader),
        independent=independent,
        warnings=tuple(str(p) for p in reader.problems if p.severity == "warning"),
        loop_tolerance=loop_tolerance,
        file=reader.document.file,
        places=reader.places,
        files=tuple(reader.files.names),
        digest=digest_of_documents(reader.files.opened.values()),
        points=tuple(points.values()),
        visuals=visuals,
    )
