"""Functions of a solver as functions of CasADi."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from ..runtime.standalone.calls.package import Package
from ..wording import nearest
from .bridged import BRIDGED, SECOND, Bridged, BridgeError
from .library import described, library
from .source import casadi_name

if TYPE_CHECKING:
    from ..runtime import Solver

OPTIONS = {"enable_forward": False, "jac_penalty": -1}
"""Options of CasADi. Derivatives along directions are computed from one Jacobian, which costs less than several
directions one by one. Adjoints come from the library's adjoint functions, which have second derivatives."""

VALID = re.compile(r"[A-Za-z](?:_?[A-Za-z0-9])*_?")
"""Pattern of names that CasADi accepts, the same as in ``casadi.Function.check_name``."""


def function(solver: Solver, name: str) -> Any:
    """Return a function of a solver as a function of CasADi, with exact derivatives.

    The function is an external library, which is compiled once and kept in the user's cache. Its arguments are those of
    q, u, p, inputs, t and udot on which it depends. In mechanisms with loops, q and u are the independent coordinates
    and speeds. The loops are closed within the call, from the model's initial state, and derivatives include the
    closure. The function may be called from several threads.

    Parameters
    ----------
    solver : Solver
        An open package, of target C or NumPy, whose numbers are float64.
    name : {"accelerations", "outputs", "energies", "coordinate_rates", "inverse_dynamics", "closure"}
        The function. `closure` takes all coordinates, and returns the scaled residuals of positions.

    Returns
    -------
    casadi.Function
        Named ``NAME_MODEL``, such as ``accelerations_four_bar``. Second derivatives are those of the solver's
        `hessian_products`; without them, CasADi can compute first derivatives only.

    Raises
    ------
    BridgeError
        A ValueError, if the package does not have the function, or CasADi does not accept its name.
    ImportError
        If CasADi is missing: it is the extra ``casadi``.
    CompileError
        If the compiler fails.

    Examples
    --------
    >>> import ordernm.casadi
    >>> f = ordernm.casadi.function(solver, "accelerations")
    >>> f.name_in(), f.name_out()
    (['q', 'u', 'p'], ['udot'])
    """
    casadi = imported()
    found = one_of(solver, name)
    path = library(solver._opened.folder, solver._opened.manifest, every(solver))
    return casadi.external(casadi_name(found.name, solver._opened.manifest["name"]), str(path), OPTIONS)


def ode(solver: Solver) -> Any:
    """Return the equations of motion as a function of CasADi, ``y' = f(y, p, inputs, t)``.

    The state y holds the independent coordinates, then the independent speeds, as in `Solver.ode`.

    Parameters
    ----------
    solver : Solver
        An open package with accelerations.

    Returns
    -------
    casadi.Function
        Named ``ode_MODEL``, with the arguments y, p, inputs and t on which the motion depends.

    Raises
    ------
    BridgeError
        As for `function`.

    Examples
    --------
    >>> import ordernm.casadi
    >>> f = ordernm.casadi.ode(solver)
    >>> f.name_in(), f.size1_out(0)
    (['y', 'p'], 4)
    """
    casadi = imported()
    accelerations, rates = function(solver, "accelerations"), _rates(solver)
    own = one_of(solver, "accelerations")
    nq, nu = own.size("q"), own.size("u") if "u" in own.arguments else len(solver.independent_speed_names)
    y = casadi.MX.sym("y", nq + nu)
    more = {a: casadi.MX.sym(a, own.size(a)) for a in own.arguments if a not in ("q", "u")}
    state = {"q": y[:nq], "u": y[nq:], **more}
    u = state["u"] if rates is None else _called(rates, state)[_places(solver, "q")]
    udot = _called(accelerations, state)[_places(solver, "u")]
    name = casadi_name("ode", solver._opened.manifest["name"])
    return casadi.Function(name, [y, *more.values()], [casadi.vertcat(u, udot)], ["y", *more], ["ydot"])


def step(solver: Solver) -> Any:
    """Return a step of the classical Runge-Kutta method as a function of CasADi, ``y_next = f(y, p, inputs, t, h)``.

    It is a step of ``solver.simulate(..., method="rk4")`` with constant inputs. The state y is that of `ode`; a
    quaternion in it is not normalised after the step. `simulate` normalises quaternions in its results only.

    Parameters
    ----------
    solver : Solver
        An open package with accelerations.

    Returns
    -------
    casadi.Function
        Named ``step_MODEL``, with the arguments of `ode` and the step size h, s. Derivatives are exact, and exist to the
        order of those of `ode`.

    Raises
    ------
    BridgeError
        As for `function`.

    Examples
    --------
    >>> import ordernm.casadi
    >>> f = ordernm.casadi.step(solver)
    >>> f.name_in(), f.name_out()
    (['y', 'p', 'h'], ['y_next'])
    """
    casadi, rate = imported(), ode(solver)
    given = {n: casadi.MX.sym(n, rate.size1_in(n)) for n in rate.name_in()}
    h = casadi.MX.sym("h")

    def at(of: float, slope: Any) -> Any:
        later = {"y": given["y"] + of * h * slope} | ({"t": given["t"] + of * h} if "t" in given else {})
        return rate(*(given | later).values())

    first = at(0.0, casadi.MX.zeros(rate.size1_out(0)))
    second = at(0.5, first)
    third = at(0.5, second)
    y = given["y"] + h / 6.0 * (first + 2.0 * second + 2.0 * third + at(1.0, third))
    name = casadi_name("step", solver._opened.manifest["name"])
    return casadi.Function(name, [*given.values(), h], [y], [*given, "h"], ["y_next"])


def _called(f: Any, state: dict[str, Any]) -> Any:
    return f(*(state[a] for a in f.name_in()))


def _places(solver: Solver, of: str) -> list[int]:
    """Indices of the independent coordinates or speeds."""
    every = solver.coordinate_names if of == "q" else solver.speed_names
    own = solver.independent_names if of == "q" else solver.independent_speed_names
    return [every.index(n) for n in own]


def _rates(solver: Solver) -> Any:
    """The function of the coordinates' rates; None if these are the speeds."""
    if not solver._opened.manifest["quaternions"]:
        return None
    return function(solver, "coordinate_rates")


# -- descriptions ------------------------------------------------------------------------------------------------------

_described: dict[tuple[str, str, int], dict[str, Bridged]] = {}


def every(solver: Solver) -> dict[str, Bridged]:
    """All functions of a solver that may become functions of CasADi."""
    if not isinstance(solver, Package):
        if type(solver).__name__ == "Solver":
            raise BridgeError("solver runs the code of its package, which another ordernm generated; generate it again")
        raise BridgeError(f"solver is of type {type(solver).__name__}; give a Solver, as ordernm.load returns it")
    opened = solver._opened
    key = str(opened.folder), str(opened.package.get("seal", "")), opened.number
    if key not in _described:
        _described[key] = described(opened.folder, opened.manifest)
    return _described[key]


def one_of(solver: Solver, name: str) -> Bridged:
    """The description of a function.

    Raises
    ------
    BridgeError
        If there is no such function, or the model has a name that CasADi does not accept.
    """
    found = every(solver)
    model = solver._opened.manifest["name"]
    if name not in BRIDGED:
        raise BridgeError(
            f"name is {name!r}, which is no function for CasADi; allowed are {', '.join(found)}"
            + nearest(name, BRIDGED)
            + (f"; {name} is ordernm.casadi.{name}(solver)" if name in ("ode", "step") else "")
        )
    if name not in found:
        raise BridgeError(
            f"the package of {model} has no {name} for CasADi; it has {', '.join(found) or 'none'}. Generate it with "
            f"functions={name!r} and the functions {', '.join(filter(None, BRIDGED[name]))}, unless the model has none"
        )
    check_name(model)
    return found[name]


def check_name(model: str) -> None:
    """Raise an error if CasADi does not accept the name of the model in names of functions.

    Raises
    ------
    BridgeError
    """
    if not VALID.fullmatch(casadi_name("f", model)):
        raise BridgeError(
            f"the model's name {model!r} begins with an underscore or has two in a row, which CasADi does not accept in names "
            f"of functions; rename the model"
        )


def needs_second(solver: Solver, name: str, purpose: str) -> None:
    """Raise an error if a function has no second derivatives.

    Raises
    ------
    BridgeError
    """
    if one_of(solver, name).second is None:
        why = (
            f"its package was generated without {SECOND[name]}; generate it with functions that include {SECOND[name]!r}"
            if name in SECOND
            else f"{name} has first derivatives only"
        )
        raise BridgeError(f"{purpose} needs second derivatives of {name}, and {solver.name} has none: {why}")


def imported() -> Any:
    """The module casadi.

    Raises
    ------
    ImportError
    """
    try:
        import casadi
    except ImportError as error:
        raise ImportError("functions for CasADi need CasADi: pip install 'ordernm[casadi]'") from error
    return casadi


__all__ = ["check_name", "every", "function", "imported", "needs_second", "ode", "one_of", "step"]
