"""Addresses of the sections that explain errors, for messages of commands."""

from __future__ import annotations

PAGE = "docs/errors.md"
"""The page that explains errors: a file of the repository, or the address of the site once there is one."""

ANCHORS = {
    "AssemblyError": "a-loop-cannot-be-closed",
    "SingularLoopError": "a-loop-has-lost-rank",
    "SingularForceError": "a-force-has-no-direction",
    "SingularOutputError": "an-output-has-no-derivative",
    "SingularJointError": "a-joint-has-no-inertia",
    "SimulationError": "a-motion-cannot-continue",
    "EquilibriumError": "no-equilibrium",
    "NoCompilerError": "no-compiler",
    "CompileError": "the-compiler-failed",
    "TargetsDifferError": "c-and-numpy-differ",
    "TooLargeError": "equations-that-are-too-large",
}
"""Anchors of error classes with a section of their own. Classes are names, because importing them takes time."""


def section(name: str) -> str:
    """The line that refers to the section of an error class."""
    return f"See {PAGE}#{ANCHORS[name]}"


def explanation(error: BaseException | None) -> str:
    """The line that refers to the section of an error, or of its cause; empty if there is none."""
    if error is None:
        return ""
    problems = getattr(error, "problems", ())
    if any(p.message.startswith("nothing ") and " has inertia" in p.message for p in problems):
        return section("SingularJointError")
    if any(p.path == "loops" and p.line is None for p in problems):
        return section("AssemblyError")  # loops that cannot be closed, or not with the coordinates under `independent`
    for kind in type(error).__mro__:
        if kind.__name__ in ANCHORS:
            return section(kind.__name__)
    return explanation(error.__cause__)


__all__ = ["ANCHORS", "PAGE", "explanation", "section"]
