"""The XML files of an FMU: ``modelDescription.xml`` of both versions of the standard, and ``buildDescription.xml``."""

from __future__ import annotations

import re
from collections.abc import Sequence
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from ...model.units import unit_of
from ...version import __version__
from .variables import Dependencies, Variable

TOOL = f"ordernm {__version__}"

CATEGORIES = ("logStatusWarning", "logStatusDiscard", "logStatusError")
"""Categories of log messages that an FMU sends."""

ANGLE = re.compile(r"(/?)\brad\b(?:(?:\^|\*\*)(-?\d+))?")


class Contents:
    """What both versions of a model description contain.

    Attributes
    ----------
    name, description, token : str
        Name and description of the model; the token that identifies the FMU.
    variables : sequence of Variable
    dependencies : Dependencies
    sources : sequence of str
        Names of the C files.
    stop, rtol : float
        Default experiment.
    """

    def __init__(
        self, name: str, description: str, variables: Sequence[Variable], dependencies: Dependencies,
        sources: Sequence[str], stop: float, rtol: float,
    ) -> None:  # fmt: skip
        self.name, self.description, self.token = name, description, ""
        self.variables, self.dependencies, self.sources = variables, dependencies, sources
        self.stop, self.rtol = stop, rtol

    def numbers(self, *kinds: str) -> list[int]:
        """Value references of the variables of some kinds."""
        return [n for n, x in enumerate(self.variables) if x.kind in kinds]

    @property
    def initial_unknowns(self) -> list[int]:
        """Value references of outputs, states and time derivatives that are computed in initialisation."""
        return [n for n in self.numbers("q", "u", "rate", "output") if self.variables[n].initial != "exact"]


def xml(root: Element) -> str:
    """The text of a file."""
    indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="unicode") + "\n"


def number(x: float) -> str:
    """A double as XML writes it."""
    return repr(float(x))


def _add_units(root: Element, found: Sequence[Variable]) -> None:
    units = dict.fromkeys(x.unit for x in found if x.unit)
    definitions = SubElement(root, "UnitDefinitions")
    for name in units:
        unit = SubElement(definitions, "Unit", name=name)
        if exponents := _base_unit(name):
            SubElement(unit, "BaseUnit", exponents)


def _base_unit(name: str) -> dict[str, str]:
    """Exponents of the SI units in a unit; empty if it is only a description, or not a product of SI units."""
    known = unit_of(name.replace(" ", "*"))
    if known is None or known[0] != 1:
        return {}
    length, mass, time = known[1]
    angle = sum((-1 if below else 1) * int(power or 1) for below, power in ANGLE.findall(name))
    exponents = {"kg": mass, "m": length, "s": time, "rad": angle}
    if any(int(e) != e for e in exponents.values()):
        return {}
    return {unit: str(int(e)) for unit, e in exponents.items() if e}


def _add_categories(root: Element) -> None:
    categories = SubElement(root, "LogCategories")
    for name in CATEGORIES:
        SubElement(categories, "Category", name=name)


def _add_experiment(root: Element, of: Contents) -> None:
    SubElement(root, "DefaultExperiment", startTime="0.0", stopTime=number(of.stop), tolerance=number(of.rtol))


def _known(of: Contents, number_of: int, shift: int) -> dict[str, str]:
    """The attributes for the dependencies of an unknown."""
    numbers, constant = of.dependencies.of(number_of)
    found = {"dependencies": " ".join(str(n + shift) for n in numbers)}
    return found | {"dependenciesKind": " ".join(["constant"] * len(numbers))} if constant else found


def _entry(number_of: int, x: Variable) -> dict[str, str]:
    """The attributes of a variable that are not numbers: name, value reference, causality, variability, ``initial``."""
    found = {"name": x.name, "valueReference": str(number_of), "causality": x.causality}
    found["variability"] = "tunable" if x.kind == "parameter" else "continuous"
    return found | ({"initial": x.initial} if x.initial is not None and x.kind != "input" else {})


def _words(x: Variable) -> dict[str, str]:
    return {"description": x.description} if x.description else {}


def _values(x: Variable, shift: int) -> dict[str, str]:
    """The attributes of a number: unit, bounds, start value, and the place of its state."""
    found = {"unit": x.unit} if x.unit else {}
    for word, bound in zip(("min", "max"), x.bounds, strict=True):
        if bound is not None:
            found[word] = number(bound)
    if x.start is not None:
        found["start"] = number(x.start)
    return found | ({"derivative": str(x.state + shift)} if x.state is not None else {})


def description_3(of: Contents) -> str:
    """``modelDescription.xml`` of FMI 3.0."""
    root = Element("fmiModelDescription", fmiVersion="3.0", modelName=of.name, instantiationToken=of.token,
                   description=of.description, generationTool=TOOL, variableNamingConvention="flat")  # fmt: skip
    common = {"modelIdentifier": of.name, "canGetAndSetFMUState": "true", "canSerializeFMUState": "true",
              "providesDirectionalDerivatives": "true", "providesAdjointDerivatives": "true"}  # fmt: skip
    SubElement(root, "ModelExchange", common)
    SubElement(root, "CoSimulation", common | {"canHandleVariableCommunicationStepSize": "true"})
    _add_units(root, of.variables)
    _add_categories(root)
    _add_experiment(root, of)
    listed = SubElement(root, "ModelVariables")
    for n, x in enumerate(of.variables):
        SubElement(listed, "Float64", _entry(n, x) | _values(x, 0) | _words(x))
    structure = SubElement(root, "ModelStructure")
    for n in of.numbers("q", "u", "output"):
        SubElement(structure, "Output", {"valueReference": str(n)} | _known(of, n, 0))
    for n in of.numbers("rate"):
        SubElement(structure, "ContinuousStateDerivative", {"valueReference": str(n)} | _known(of, n, 0))
    for n in of.initial_unknowns:
        SubElement(structure, "InitialUnknown", valueReference=str(n))
    for n in of.numbers("switch"):
        SubElement(structure, "EventIndicator", {"valueReference": str(n)} | _known(of, n, 0))
    return xml(root)


def description_2(of: Contents) -> str:
    """``modelDescription.xml`` of FMI 2.0, whose places in lists count from 1."""
    root = Element("fmiModelDescription", fmiVersion="2.0", modelName=of.name, guid=of.token, description=of.description,
                   generationTool=TOOL, variableNamingConvention="flat",
                   numberOfEventIndicators=str(len(of.numbers("switch"))))  # fmt: skip
    common = {"modelIdentifier": of.name, "canGetAndSetFMUstate": "true", "canSerializeFMUstate": "true",
              "providesDirectionalDerivative": "true"}  # fmt: skip
    more = {"CoSimulation": {"canHandleVariableCommunicationStepSize": "true"}}
    for kind in ("ModelExchange", "CoSimulation"):
        files = SubElement(SubElement(root, kind, common | more.get(kind, {})), "SourceFiles")
        for name in of.sources:
            SubElement(files, "File", name=name)
    _add_units(root, of.variables)
    _add_categories(root)
    _add_experiment(root, of)
    listed = SubElement(root, "ModelVariables")
    for n, x in enumerate(of.variables):
        SubElement(SubElement(listed, "ScalarVariable", _entry(n, x) | _words(x)), "Real", _values(x, 1))
    structure = SubElement(root, "ModelStructure")
    outputs, derivatives = of.numbers("q", "u", "output"), of.numbers("rate")
    for word, numbers in (("Outputs", outputs), ("Derivatives", derivatives)):
        if numbers:
            unknowns = SubElement(structure, word)
            for n in numbers:
                SubElement(unknowns, "Unknown", {"index": str(n + 1)} | _known(of, n, 1))
    if of.initial_unknowns:
        unknowns = SubElement(structure, "InitialUnknowns")
        for n in of.initial_unknowns:
            SubElement(unknowns, "Unknown", index=str(n + 1))
    return xml(root)


def build_description(of: Contents, definitions: Sequence[str]) -> str:
    """``sources/buildDescription.xml`` of FMI 3.0."""
    root = Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = SubElement(root, "BuildConfiguration", modelIdentifier=of.name)
    files = SubElement(configuration, "SourceFileSet", language="C11")
    for name in of.sources:
        SubElement(files, "SourceFile", name=name)
    for name in definitions:
        SubElement(files, "PreprocessorDefinition", name=name)
    SubElement(configuration, "Library", name="m")
    return xml(root)
