"""The table of fields, and the fields that blocks store and load: misspelt, missing or unread fields stop generation."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from coupled_mechanisms import by_hand
from point_condition_models import MODELS as ON_POINTS
from prescribed_models import bars
from random_mechanisms import random_mechanisms
from rotor_models import with_rotors

import codegen
from codegen.loops.partition import partition
from codegen.mechanics import fields, procedures
from codegen.mechanics.expansion import expand
from codegen.mechanics.fields import FIELDS
from codegen.mechanics.glossary import glossary
from codegen.mechanics.patterns import Patterns
from codegen.mechanics.quantities import QUANTITIES
from codegen.mechanics.stores import CONSTANTS, LAID_OUT, ME
from codegen.mechanics.structure.system import System, analyse
from codegen.mechanics.sweeps import SWEEPS, Sweep
from codegen.program import field_table
from codegen.program.block import FieldError, Scope
from codegen.program.counting import sweeps as sweeps_run
from codegen.program.field import Field, ScalarField
from codegen.program.procedure import Run

EXAMPLES = Path(__file__).parents[2] / "examples"
MODELS = (
    "four_bar", "satellite", "arm", "closed_chain", "stewart", "planar_3rrr", "sprung_tips", "platform_on_ground",
    "chain_on_slide", "tips_slide", "random", "shaken_pendulum", "driven_bars", "on a free base",
)  # fmt: skip
"""Between them they have every kind of link, ear, region and spring."""

OF_TREES = {"newton_euler_out", "newton_euler_in", "force_tangents", "solve_in", "mass_out", "mass_in"}
"""Sweeps that models with loops do not have."""

Site = tuple[str, str, str, str]
"""Sweep, role of the unit, store and field."""


def system(name: str) -> System:
    file = EXAMPLES / f"{name}.yaml"
    if name == "random":
        model = next(m.model for seed, m in random_mechanisms(1, first=3))
    elif name == "driven_bars":
        model = with_rotors(np.random.default_rng(0), bars("cart"), 1.0)
    elif name in ON_POINTS:
        model = codegen.parse_model(ON_POINTS[name])
    else:
        model = codegen.load_model(file) if file.exists() else by_hand(name).model
    return analyse(model, False, partition(model) if model.loops else None)


def sweeps(of: System) -> list[Sweep]:
    """All sweeps that the functions of a model run, and those that its outputs could need."""
    run = sweeps_run(procedures.procedures(of, reactions=True))
    run |= {step.sweep for q in QUANTITIES.values() for step in (*q.values, *q.tangents) if isinstance(step, Run)}
    return [s for s in SWEEPS if s.name in run and s.kinds(of)]


class Watched:
    """Runs block-writing code on zero patterns; the stored values can be inspected, changed or removed."""

    def __init__(self, patch: pytest.MonkeyPatch):
        self.writer: tuple[str, str] = ("", "")
        self.stored: dict[Site, Field[Any]] = {}
        self.loaded: set[str] = set()
        self.misspelt: Site | None = None
        self.dropped: Site | None = None
        store, load, write = Scope.store, Scope.load, Sweep.write_block

        def watched_store(x: Scope, to: Any, field: Any, value: Any) -> None:
            if to.memory in LAID_OUT:
                site = (*self.writer, repr(to).partition("#")[0], field.family.name)
                self.stored[site] = field.family
                if site == self.dropped:
                    return
                if site == self.misspelt:
                    field = type(field)(f"{field.name}_", field.unit, field.frame, field.meaning)
            store(x, to, field, value)

        def watched_load(x: Scope, of: Any, field: Any) -> Any:
            self.loaded.add(field.family.name)
            return load(x, of, field)

        def watched_block(sweep: Sweep, x: Any, kind: Any) -> Any:
            self.writer = sweep.name, kind.role
            return write(sweep, x, kind)

        patch.setattr(Scope, "store", watched_store)
        patch.setattr(Scope, "load", watched_load)
        patch.setattr(Sweep, "write_block", watched_block)

    def run(self, of: System) -> Patterns:
        patterns = Patterns(of)
        for sweep in sweeps(of):
            patterns.settle(sweep)
        return patterns

    def sites(self, of: System) -> Iterator[Site]:
        self.stored.clear()
        self.run(of)
        yield from list(self.stored)


@pytest.mark.parametrize("name", MODELS)
def test_a_misspelt_field_stops_generation_wherever_it_is_stored(name, monkeypatch):
    watched = Watched(monkeypatch)
    patterns = watched.run(system(name))
    for site in list(watched.stored):
        watched.misspelt = site
        sweep = next(s for s in SWEEPS if s.name == site[0])
        with pytest.raises(FieldError) as error:
            patterns.settle(sweep)
        assert f"{sweep.title}: " in str(error.value)
        assert "is not in the table of fields" in str(error.value)
        watched.misspelt = None


@pytest.mark.parametrize("name", ("four_bar", "satellite", "closed_chain", "platform_on_ground"))
def test_a_forgotten_store_stops_generation(name, monkeypatch):
    """Where one writer alone stores what is loaded, and nobody can do without: others that write it too are not told apart."""
    watched, model = Watched(monkeypatch), system(name)
    sites = list(watched.sites(model))
    looked_at = 0
    for site in sites:
        field = watched.stored[site]
        alone = sum(s[3] == site[3] for s in sites) == 1
        if alone and not field.propagated and field.name in watched.loaded:
            looked_at += 1
            watched.dropped = site
            with pytest.raises(FieldError, match="is loaded, and no block stores it"):
                watched.run(model)
            watched.dropped = None
    assert looked_at


@pytest.mark.parametrize("unread", ("", "there is nothing to read it for"))
@pytest.mark.parametrize("name", ("four_bar", "double_pendulum"))
def test_what_nobody_reads_stops_generation_unless_the_table_says_when(name, unread, monkeypatch):
    spare = ScalarField("spare", "m", "", "what nobody reads", unread=unread)
    spare.listed = True
    write, of = Sweep.write_block, system(name)

    def more(sweep: Sweep, x: Any, kind: Any) -> Any:
        found = write(sweep, x, kind)
        if sweep.name == "kinematics" and kind.role != "region":
            store = ME[0] if kind.role == "ear" else ME
            x.store(store, spare, x.load(CONSTANTS[0] if kind.role == "ear" else CONSTANTS, fields.mass))
        return found

    monkeypatch.setattr(Sweep, "write_block", more)
    asked = {s.name for s in sweeps(of)}
    if unread:
        expand(of, asked)
    else:
        with pytest.raises(FieldError, match=r"me.*\.spare is stored, and no block or formula reads spare"):
            expand(of, asked)
        expand(of, asked, whole=False)  # of some functions only


def test_every_field_of_the_table_is_stored_and_loaded(monkeypatch):
    watched = Watched(monkeypatch)
    stored: set[str] = set()
    for name in MODELS:
        stored |= {site[3] for site in watched.sites(system(name))}
    names = {f.name: name for name, f in FIELDS.items()}
    constants = {
        "m",
        "h",
        "J",
        "r",
        "R",
        "factor",
        "rotor{}",
        "{}.r",
        "{}.F",
        "factor{}",
        "offset",
        "part{}",
        "cos",
        "sin",
    }
    along = {"lever_tangent", "arm_tangent"}  # tangents ask for them, which zero patterns do not have
    assert {names[n] for n in stored - watched.loaded} - along == set()
    on_request = {
        "attitude_turn",
        "closing_force",
        "coupling_force",
        "multiplier_gain",
        "tree_transmitted",
    }  # by second derivatives
    assert {names[n] for n in names.keys() - stored - constants} == on_request


def test_fields_say_what_they_are():
    for name, field in FIELDS.items():
        assert field.meaning and field.unit, name
        assert field.shape, name


def test_the_glossary_is_as_the_table_of_fields_has_it():
    page = EXAMPLES.parent / "docs" / "glossary.md"
    assert page.read_text(encoding="utf-8") == glossary(), "python -m codegen.mechanics.glossary > docs/glossary.md"


def test_names_in_generated_code_belong_to_one_component_each() -> None:
    """Components that generated code calls the same are the same: no member of a struct stands there twice."""
    called: dict[str, str] = {}
    for name, field in FIELDS.items():
        for component, identifier in zip(field.components, field.identifiers, strict=True):
            assert identifier.replace("{}", "A").isidentifier(), name
            assert called.setdefault(identifier, component) == component, name
            numbered, number = component.replace("{}", "3"), identifier.replace("{}", "3")
            assert field_table.identifier(numbered) == number
            assert field_table.identifier(f"{numbered}/2") == f"{number}_d2"
            assert field_table.field_of(numbered) is not None


@pytest.mark.parametrize(
    ("component", "identifier"),
    [("w.y", "omega_y"), ("acc.n.y", "articulated_moment_y"), ("Z3.w.x", "per_source_3_omega_x"), ("m/0", "mass_d0")],
)
def test_memory_has_names(component: str, identifier: str) -> None:
    assert field_table.identifier(component) == identifier
