"""The equations of motion of a model as matrices of sympy."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import sympy

from ..loops.errors import AssemblyError, PartitionError
from ..model.errors import ModelError, nearest
from ..model.model import Model
from ..reference.arithmetic import Array
from .errors import SymbolicError, TooLargeError
from .outputs import Outputs
from .polynomials import UndecidedError, exact
from .size import expected_terms
from .system import MOST_TERMS, SymbolicEngine, matrix_of, symbols_of

FORMS = ("tree", "multipliers", "embedded")
"""Of models without loops; of models with loops: with multipliers, and in the independent speeds."""

MOST_PRODUCTS = 200_000
"""Equations that take more products of terms, about ten for each term, are computed only if forced."""


LARGEST = 2**53
"""Whole numbers up to this one are exact as floats."""


@dataclass(frozen=True)
class Equations:
    """Equations of motion in the names of the model, all symbols real.

    Made by `equations`. Coordinates are ``q.NAME``, speeds ``u.NAME``, accelerations ``udot.NAME``; parameters, inputs and ``t``
    have their own names. The form says what holds:

    =============== =============================================================================================
    ``tree``        M udot = forcing
    ``multipliers`` M udot + J^T multipliers = forcing and J udot = -rate, where position = 0 and J u = -drift
    ``embedded``    M udot_i = forcing for the independent accelerations, u = S u_i + s, udot = S udot_i + remainder
    =============== =============================================================================================

    Attributes
    ----------
    name : str
        Of the model.
    form : {"tree", "multipliers", "embedded"}
    t : sympy.Symbol
        Time, s.
    q : tuple of Symbol
        Coordinates (nq,), without those that are prescribed.
    u, udot : tuple of Symbol
        Speeds and their time derivatives, (nu,).
    independent : tuple of Symbol
        The speeds whose accelerations M multiplies: all of them, but for the embedded form.
    parameters : tuple of Symbol
        Those that are symbols still.
    inputs : tuple of Symbol
    qdot : sympy.Matrix
        Time derivatives of the coordinates, (nq, 1).
    M : sympy.Matrix
        Mass matrix, (n, n) with n the number of independent speeds.
    forcing : sympy.Matrix
        Right side, (n, 1): forces, gravity, and what does not depend on the accelerations.
    J : sympy.Matrix or None
        With multipliers: the constraint Jacobian, (r, nu).
    rate : sympy.Matrix or None
        With multipliers: dJ/dt u, and what prescribed motion adds, (r, 1).
    drift : sympy.Matrix or None
        With loops and prescribed motion: what prescribed speeds add to J u, (r, 1); zero where it is None.
    position : sympy.Matrix or None
        With loops: the constraints, (r, 1), m, and sines of angles.
    constraints : tuple of str
        With loops: names of the constraints, in the order of the rows of J.
    multipliers : tuple of Symbol
        With multipliers, (r,): N, and N m.
    S : sympy.Matrix or None
        Embedded: all speeds from the independent ones, (nu, n).
    s : sympy.Matrix or None
        Embedded, with prescribed motion: what prescribed speeds add to the speeds, (nu, 1); zero where it is None.
    remainder : sympy.Matrix or None
        Embedded: accelerations where the independent ones are zero, (nu, 1).
    outputs : mapping of str to sympy.Expr
        The outputs of the model; accelerations are symbols ``udot.NAME`` in them.
    defaults : dict of Symbol to sympy.Expr
        The model's values of `parameters`, and zero for inputs.
    """

    name: str
    form: str
    t: sympy.Symbol
    q: tuple[sympy.Symbol, ...]
    u: tuple[sympy.Symbol, ...]
    udot: tuple[sympy.Symbol, ...]
    independent: tuple[sympy.Symbol, ...]
    parameters: tuple[sympy.Symbol, ...]
    inputs: tuple[sympy.Symbol, ...]
    qdot: sympy.Matrix
    M: sympy.Matrix
    forcing: sympy.Matrix
    J: sympy.Matrix | None = None
    rate: sympy.Matrix | None = None
    drift: sympy.Matrix | None = None
    position: sympy.Matrix | None = None
    constraints: tuple[str, ...] = ()
    multipliers: tuple[sympy.Symbol, ...] = ()
    S: sympy.Matrix | None = None
    s: sympy.Matrix | None = None
    remainder: sympy.Matrix | None = None
    outputs: Outputs = field(default_factory=Outputs)
    defaults: dict[sympy.Symbol, sympy.Expr] = field(default_factory=dict)

    def symbol(self, name: str) -> sympy.Symbol:
        """Return the symbol of a name.

        Parameters
        ----------
        name : str
            Such as ``q.crank``.

        Returns
        -------
        sympy.Symbol
            The symbol.

        Raises
        ------
        SymbolicError
            If there is none.

        Examples
        --------
        >>> from ordernm.symbolic import equations
        >>> found = equations(ordernm.load_model("examples/double_pendulum.yaml"))
        >>> found.symbol("length_1")
        length_1
        """
        known = {s.name: s for s in (*self.q, *self.u, *self.udot, *self.parameters, *self.inputs, self.t)}
        known |= {s.name: s for s in self.multipliers}
        if name not in known:
            raise SymbolicError(f"{self.name} has no symbol {name!r}; it has {', '.join(known)}{nearest(name, known)}")
        return known[name]

    @property
    def matrices(self) -> dict[str, sympy.Matrix]:
        """The matrices of the form by name, dict of str to sympy.Matrix."""
        every = {name: getattr(self, name) for name in MATRICES}
        return {name: of for name, of in every.items() if of is not None}

    @property
    def terms(self) -> int:
        """The number of terms of all matrices."""
        return sum(len(sympy.Add.make_args(x)) for of in self.matrices.values() for x in of if x != 0)

    def subs(self, values: Mapping[Any, Any]) -> Equations:
        """Return the equations with values for some symbols.

        Parameters
        ----------
        values : mapping
            Values by symbol or by name. ``equations.defaults`` has the model's values of all parameters.

        Returns
        -------
        Equations
            The equations with these values.

        Examples
        --------
        >>> from ordernm.symbolic import equations
        >>> found = equations(ordernm.load_model("examples/double_pendulum.yaml"))
        >>> found.subs({"length_2": 1, "mass_2": 3}).M[1, 1]
        2501/2500
        """
        by = {self.symbol(k) if isinstance(k, str) else k: _number(v) for k, v in values.items()}
        changed = {name: of.subs(by) for name, of in self.matrices.items()}
        left = {name: tuple(s for s in getattr(self, name) if s not in by) for name in ("parameters", "inputs")}
        outputs = Outputs({name: e.subs(by) for name, e in self.outputs.items()}, self.outputs.refused)
        known = {s: v for s, v in self.defaults.items() if s not in by}
        new: dict[str, Any] = {**changed, **left, "outputs": outputs, "defaults": known}
        return replace(self, **new)

    def lambdify(self, modules: str = "numpy", cse: bool = True) -> Callable[..., dict[str, Array]]:
        """Return a function of numbers that computes all matrices.

        Parameters
        ----------
        modules : str, optional
            As in `sympy.lambdify`.
        cse : bool, optional
            Compute common subexpressions once.

        Returns
        -------
        callable
            ``f(q, u, p=None, inputs=None, t=0.0)``, which returns a dict of arrays by the names of the matrices. ``p``
            has the values of `parameters`; left out: the model's. Inputs left out are zero.

        Examples
        --------
        >>> from ordernm.symbolic import equations
        >>> found = equations(ordernm.load_model("examples/double_pendulum.yaml"))
        >>> found.lambdify()([1.2, -0.4], [0.0, 0.0])["M"].round(4)
        array([[2.4505, 0.5819],
               [0.5819, 0.2135]])
        """
        of = self.matrices
        arguments = [*self.q, *self.u, *self.parameters, *self.inputs, self.t]
        if more := {s for m in of.values() for s in m.free_symbols} - set(arguments):
            names = ", ".join(sorted(s.name for s in more))
            raise SymbolicError(f"lambdify: {names} have no values; put numbers in their place with subs")
        found = sympy.lambdify(arguments, [[_floats(x) for x in m] for m in of.values()], modules=modules, cse=cse)
        default = [float(self.defaults[s]) for s in self.parameters]

        def evaluate(q: Any, u: Any, p: Any = None, inputs: Any = None, t: float = 0.0) -> dict[str, Array]:
            parts = {"q": (q, self.q), "u": (u, self.u), "p": (default if p is None else p, self.parameters),
                     "inputs": (np.zeros(len(self.inputs)) if inputs is None else inputs, self.inputs)}  # fmt: skip
            numbers: list[Any] = []
            for name, (given, symbols) in parts.items():
                if len(given) != len(symbols):
                    raise SymbolicError(f"{name} has {len(given)} entries, expected {len(symbols)}")
                numbers += list(given)
            with np.errstate(divide="ignore", invalid="ignore"):  # the other cases of case distinctions
                entries = found(*numbers, t)
            return {
                name: np.array(x, dtype=float).reshape(m.shape)
                for (name, m), x in zip(of.items(), entries, strict=True)
            }

        return evaluate


MATRICES = ("M", "forcing", "qdot", "position", "J", "rate", "drift", "S", "s", "remainder")
"""The fields of `Equations` that are matrices."""


def equations(
    model: Model,
    *,
    parameters: Mapping[str, Any] | str | None = None,
    form: str | None = None,
    simplify: bool = False,
    force: bool = False,
) -> Equations:
    """Return the equations of motion of a model as matrices of sympy.

    Numbers of the model stay exact: 0.02 is 1/50. Products are expanded, and sin(x)**2 is written as 1 - cos(x)**2.

    Parameters
    ----------
    model : Model
        The model.
    parameters : mapping of str to number or sympy.Expr, or "values", optional
        Values of parameters that shall not be symbols. ``"values"``: the model's values for all.
    form : {"tree", "multipliers", "embedded"}, optional
        Form for a model with loops: with multipliers (the default), or in the independent speeds. A model without loops
        has the form ``"tree"``. See `Equations`.
    simplify : bool, optional
        Apply `sympy.simplify` to every entry, which may take long.
    force : bool, optional
        Compute equations that are expected to have more than 20 000 terms too.

    Returns
    -------
    Equations
        The equations, with the names of the model.

    Raises
    ------
    SymbolicError
        If a parameter or form is unknown, or sympy has no formula for a part of the model. It names the part.
    TooLargeError
        If the equations have too many terms.

    Examples
    --------
    >>> import ordernm
    >>> from ordernm.symbolic import equations
    >>> model = ordernm.load_model("examples/double_pendulum.yaml")
    >>> found = equations(model, parameters={"damping": 0, "stiffness": 0})
    >>> found.u
    (u.upper, u.lower)
    >>> found.M[1, 1]
    length_2**2*mass_2/3 + mass_2/7500
    >>> found.lambdify()([0.1, 0.2], [0.0, 0.0])["M"].shape
    (2, 2)
    """
    found = _computed(model, _parameters(model, parameters), _form(model, form), None if force else MOST_PRODUCTS)
    return _simplified(found) if simplify else found


def _computed(model: Model, given: dict[str, sympy.Expr], form: str, most_products: int | None) -> Equations:
    try:
        if most_products is not None and (expected := expected_terms(model, given)) > MOST_TERMS:
            raise TooLargeError(f"about {expected:.0e} terms")
        return _assembled(model, SymbolicEngine(model, given, most_products), form, given)
    except (AssemblyError, PartitionError) as error:
        raise ModelError([model.problem("loops", str(error))]) from None
    except ZeroDivisionError as error:
        raise SymbolicError(f"{model.name}: {error} in every state; an axis, a distance or a pivot vanishes") from None
    except UndecidedError as error:
        raise SymbolicError(f"{model.name}: a formula has different values in different states ({error})") from None
    except TooLargeError as error:
        raise TooLargeError(
            f"the equations of {model.name} have {error}; allowed are {MOST_TERMS}. Give numbers for parameters "
            f'(parameters="values", --values), take another form, or compute them all the same (force=True, --force)'
        ) from None


def _form(model: Model, form: str | None) -> str:
    allowed = FORMS[1:] if model.loops else FORMS[:1]
    if form is None:
        return allowed[0]
    if form not in allowed:
        loops = "closed loops" if model.loops else "no closed loops"
        raise SymbolicError(
            f"form: {form!r} is not possible; {model.name} has {loops}, so allowed is {' or '.join(allowed)}"
        )
    return form


def _parameters(model: Model, given: Mapping[str, Any] | str | None) -> dict[str, sympy.Expr]:
    if given is None:
        return {}
    if isinstance(given, str):
        if given != "values":
            raise SymbolicError(f'parameters: {given!r} is not known; give "values", or values by name')
        return {p.name: exact(p.value) for p in model.parameters}
    for name in given:
        if name not in model.parameter_names:
            known = ", ".join(model.parameter_names) or "none"
            raise SymbolicError(
                f"parameters: {model.name} has no parameter {name!r}; it has {known}{nearest(name, model.parameter_names)}"
            )
    return {name: _number(value) for name, value in given.items()}


def _number(value: Any) -> sympy.Expr:
    if isinstance(value, sympy.Expr):
        return value
    if isinstance(value, float | np.floating):
        if not np.isfinite(value):
            raise SymbolicError(f"{value} is not a finite number")
        return exact(float(value))
    try:
        found = sympy.sympify(value, strict=True)
    except sympy.SympifyError:
        found = None
    if not isinstance(found, sympy.Expr):
        raise SymbolicError(f"{value!r} is neither a number nor an expression of sympy's")
    return found


def _floats(e: sympy.Expr) -> sympy.Expr:
    """An expression whose exact numbers are within the range of machine integers: the others become floats."""
    large = {x: sympy.Float(x, 17) for x in e.atoms(sympy.Rational) if max(abs(x.p), x.q) > LARGEST}
    return e.xreplace(large) if large else e


def _assembled(model: Model, engine: SymbolicEngine, form: str, given: Collection[str]) -> Equations:
    f = engine.free_u
    M, forcing = engine.mass[np.ix_(f, f)], engine.right_side[f]
    more: dict[str, Any] = {}
    independent = engine.u
    if model.loops:
        more = _with_loops(engine, form)
        if form == "embedded":
            place = {i: k for k, i in enumerate(f.tolist())}
            free = [i for i in f.tolist() if i not in set(engine.dependent.tolist())]
            independent = tuple(engine.u[place[i]] for i in free)
            S, remainder = more["S"], more["remainder"]
            forcing = S.T * (matrix_of(forcing) - matrix_of(M) * remainder)
            M = S.T * matrix_of(M) * S
    defaults = {s: exact(p.value) for s, p in zip(engine.p, model.parameters, strict=True) if p.name not in given}
    return Equations(
        model.name, form, engine.t, engine.q, engine.u, engine.udot, independent, tuple(defaults), engine.inputs,
        matrix_of(engine.rates), _matrix(M), _matrix(forcing), **more, outputs=Outputs.of(engine),
        defaults=defaults | dict.fromkeys(engine.inputs, sympy.Integer(0)),
    )  # fmt: skip


def _matrix(of: Array | sympy.Matrix) -> sympy.Matrix:
    return of if isinstance(of, sympy.MatrixBase) else matrix_of(of)


def _with_loops(engine: SymbolicEngine, form: str) -> dict[str, Any]:
    known, f, held = engine.constraints, engine.free_u, engine.held
    given = engine.state.u.value
    common: dict[str, Any] = {"position": matrix_of(known.position), "constraints": tuple(known.names)}
    if len(held):
        common["drift"] = matrix_of(known.jacobian[:, held] @ given[held])
    if form == "multipliers":
        return common | {
            "J": matrix_of(known.jacobian[:, f]), "rate": matrix_of(known.remainder),
            "multipliers": symbols_of(known.names, "lambda."),
        }  # fmt: skip
    dependent = set(engine.dependent.tolist())
    free = [i for i in f.tolist() if i not in dependent]
    motion = engine.motion_of_tree
    if len(held):
        common["s"] = matrix_of(motion[np.ix_(f, held)] @ given[held])
    return common | {"S": matrix_of(motion[np.ix_(f, free)]), "remainder": matrix_of(engine.remainder_of_tree[f])}


def _simplified(found: Equations) -> Equations:
    new: dict[str, Any] = {name: of.applyfunc(sympy.simplify) for name, of in found.matrices.items()}
    outputs = Outputs({n: sympy.simplify(e) for n, e in found.outputs.items()}, found.outputs.refused)
    return replace(found, **new, outputs=outputs)


__all__ = ["FORMS", "Equations", "equations"]
