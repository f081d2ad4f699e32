"""The equations of motion of a model as matrices of sympy."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
import sympy

from ..html_tables import html_of
from ..loops.errors import AssemblyError, PartitionError
from ..model.errors import ModelError, nearest
from ..model.model import Model
from ..reference.arithmetic import Array
from .entries import count, floats, needed, steps
from .errors import SymbolicError, TooLargeError, TooManyProductsError
from .outputs import Outputs
from .polynomials import UndecidedError, exact
from .size import expected_terms, most_terms
from .system import MOST_TERMS, SymbolicEngine, matrix_of, symbols_of

FORMS = ("tree", "multipliers", "embedded")
"""Forms of the equations: without loops, with loops and multipliers, or in the independent speeds."""

MOST_PRODUCTS = 600_000
"""Largest number of products of terms for equations that are computed without `force`."""


@dataclass(frozen=True)
class Equations:
    """Equations of motion in the names of the model, all symbols real.

    Made by `equations`. Coordinates are ``q.NAME``, speeds ``u.NAME``, accelerations ``udot.NAME``; parameters, inputs and ``t``
    have their own names. The equations depend on the form:

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
        The speeds whose accelerations M multiplies: all speeds, except in the embedded form.
    parameters : tuple of Symbol
        The parameters that are symbols.
    inputs : tuple of Symbol
    qdot : sympy.Matrix
        Time derivatives of the coordinates, (nq, 1).
    M : sympy.Matrix
        Mass matrix, (n, n) with n the number of independent speeds.
    forcing : sympy.Matrix
        Right side, (n, 1): forces, gravity, and all other terms without accelerations.
    J : sympy.Matrix or None
        With multipliers: the constraint Jacobian, (r, nu).
    rate : sympy.Matrix or None
        With multipliers: dJ/dt u plus the contribution of prescribed motion, (r, 1).
    drift : sympy.Matrix or None
        With loops and prescribed motion: the contribution of prescribed speeds to J u, (r, 1); None means zero.
    position : sympy.Matrix or None
        With loops: the constraints, (r, 1), m, and sines of angles.
    constraints : tuple of str
        With loops: names of the constraints, in the order of the rows of J.
    multipliers : tuple of Symbol
        With multipliers, (r,): N, and N m.
    S : sympy.Matrix or None
        Embedded: all speeds from the independent ones, (nu, n).
    s : sympy.Matrix or None
        Embedded, with prescribed motion: the contribution of prescribed speeds to u, (nu, 1); None means zero.
    remainder : sympy.Matrix or None
        Embedded: accelerations where the independent ones are zero, (nu, 1).
    intermediates : dict of Symbol to sympy.Expr
        Intermediate variables ``z1``, ``z2``, ... of the matrices and outputs with their values, each after those that it
        needs. Empty unless asked for.
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
    intermediates: dict[sympy.Symbol, sympy.Expr] = field(default_factory=dict)
    outputs: Outputs = field(default_factory=Outputs)
    defaults: dict[sympy.Symbol, sympy.Expr] = field(default_factory=dict)

    def __repr__(self) -> str:
        loops = f", {len(self.constraints)} constraints" if self.constraints else ""
        return f"<Equations of {self.name}, {self.form}: M {self.M.shape} and forcing of {len(self.u)} speeds{loops}>"

    def _repr_html_(self) -> str:
        return html_of(
            [repr(self)], ("speed", "forcing"), zip(map(str, self.independent), map(str, self.forcing), strict=True)
        )

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
        known |= {s.name: s for s in (*self.multipliers, *self.intermediates)}
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
        """The number of terms of all matrices and intermediate variables, including terms of sums within products."""
        every = [*self.intermediates.values(), *(x for of in self.matrices.values() for x in of)]
        known: dict[sympy.Basic, int] = {}
        return sum(count(x, known) for x in every if x != 0)

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
        inner = {s: e.subs(by) for s, e in self.intermediates.items() if s not in by}
        new: dict[str, Any] = {**changed, **left, "outputs": outputs, "defaults": known, "intermediates": inner}
        return replace(self, **new)

    def lambdify(
        self, modules: str = "numpy", cse: bool = True, outputs: bool = False
    ) -> Callable[..., dict[str, Array]]:
        """Return a function of numbers that computes all matrices.

        Parameters
        ----------
        modules : str, optional
            As in `sympy.lambdify`.
        cse : bool, optional
            Compute common subexpressions once. Where there are intermediate variables, these are computed instead.

        outputs : bool, optional
            Compute the outputs too.

        Returns
        -------
        callable
            ``f(q, u, p=None, inputs=None, t=0.0, udot=None)``, which returns a dict of arrays by the names of the matrices,
            and ``"outputs"`` (n, 1). ``p`` has the values of `parameters`; left out: the model's. Inputs left out are zero.
            Accelerations ``udot`` are for outputs alone, and NaN if they are left out.

        Examples
        --------
        >>> from ordernm.symbolic import equations
        >>> found = equations(ordernm.load_model("examples/double_pendulum.yaml"))
        >>> found.lambdify()([1.2, -0.4], [0.0, 0.0])["M"].round(4)
        array([[2.4505, 0.5819],
               [0.5819, 0.2135]])
        """
        of = self.matrices | ({"outputs": sympy.Matrix(list(self.outputs.values()))} if outputs else {})
        inner = {s: floats(e) for s, e in needed(of.values(), list(self.intermediates.items())).items()}
        arguments = [*self.q, *self.u, *self.parameters, *self.inputs, *(self.udot if outputs else ()), self.t]
        every = {s for e in (*of.values(), *inner.values()) for s in e.free_symbols}
        if more := every - {*arguments, *inner}:
            missing = ", ".join(sorted(s.name for s in more))
            raise SymbolicError(f"lambdify: {missing} have no values; put numbers in their place with subs")
        entries = [[floats(x) for x in m] for m in of.values()]
        found = sympy.lambdify(arguments, entries, modules=modules, cse=partial(steps, inner, cse))
        names = {
            "q": self.q,
            "u": self.u,
            "p": self.parameters,
            "inputs": self.inputs,
            "udot": self.udot if outputs else (),
        }
        default = {
            "p": [float(self.defaults[s]) for s in self.parameters],
            "inputs": [0.0] * len(self.inputs),
            "udot": [np.nan] * len(names["udot"]),
        }
        return _evaluation(names, default, {name: m.shape for name, m in of.items()}, found)


def _evaluation(
    names: dict[str, tuple[sympy.Symbol, ...]],
    default: dict[str, list[float]],
    shapes: dict[str, tuple[int, int]],
    computed: Callable[..., Any],
) -> Callable[..., dict[str, Array]]:
    """The function that `Equations.lambdify` returns, from the function `computed`, which computes entries from numbers."""

    def evaluate(
        q: Any, u: Any, p: Any = None, inputs: Any = None, t: float = 0.0, udot: Any = None
    ) -> dict[str, Array]:
        numbers: list[Any] = []
        for (name, symbols), given in zip(names.items(), (q, u, p, inputs, udot), strict=True):
            value = default[name] if given is None else given
            if len(value) != len(symbols):
                raise SymbolicError(f"{name} has {len(value)} entries, expected {len(symbols)}")
            numbers += list(value)
        with np.errstate(divide="ignore", invalid="ignore"):  # branches of piecewise expressions that are not used
            entries = computed(*numbers, t)
        return {
            name: np.array(x, dtype=float).reshape(shape)
            for (name, shape), x in zip(shapes.items(), entries, strict=True)
        }

    return evaluate


MATRICES = ("M", "forcing", "qdot", "position", "J", "rate", "drift", "S", "s", "remainder")
"""The fields of `Equations` that are matrices."""


def equations(
    model: Model,
    *,
    parameters: Mapping[str, Any] | str | None = None,
    form: str | None = None,
    intermediates: bool = False,
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
    intermediates : bool, optional
        Introduce intermediate variables ``z1``, ``z2``, ... for long sums, instead of multiplying them out. The equations
        of large mechanisms then have some thousand terms. See `Equations.intermediates`.
    simplify : bool, optional
        Apply `sympy.simplify` to every entry, which may take long.
    force : bool, optional
        Compute equations that have more than 20 000 terms too, however long it takes.

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
    most = None if force else MOST_PRODUCTS
    found = _computed(model, _parameters(model, parameters), _form(model, form), intermediates, most)
    return _simplified(found) if simplify else found


def _computed(
    model: Model, given: dict[str, sympy.Expr], form: str, intermediates: bool, most_products: int | None
) -> Equations:
    try:
        if most_products is not None and (expected := expected_terms(model, given, intermediates)) > MOST_TERMS:
            raise TooLargeError(f"about {expected:.0e} terms")
        return _assembled(model, SymbolicEngine(model, given, most_products, intermediates), form, given)
    except (AssemblyError, PartitionError) as error:
        raise ModelError([model.problem("loops", str(error))]) from None
    except ZeroDivisionError as error:
        raise SymbolicError(f"{model.name}: {error} in every state; an axis, a distance or a pivot vanishes") from None
    except UndecidedError as error:
        raise SymbolicError(f"{model.name}: a formula has different values in different states ({error})") from None
    except TooManyProductsError:
        size = f"up to {most_terms(model, given):.0e} terms"
    except TooLargeError as error:
        size = str(error)
    raise TooLargeError(
        f"the equations of {model.name} have {size}; allowed are {MOST_TERMS}. {_smaller(model, given, form, intermediates)}"
        f'give numbers for parameters (parameters="values", --values), or compute them all the same (force=True, --force-size)'
    )


def _smaller(model: Model, given: dict[str, sympy.Expr], form: str, intermediates: bool) -> str:
    """The size of the equations with intermediate variables, as part of a message."""
    if intermediates:
        return "Please "
    try:
        found = _computed(model, given, form, True, MOST_PRODUCTS)
    except SymbolicError:
        return "Please "
    return f"Take intermediate variables (intermediates=True, --intermediates), which give {found.terms} terms, "


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
    if not isinstance(given, Mapping):
        raise SymbolicError(f'parameters: {given!r} is not a mapping; give "values", or values by name')
    for name in given:
        if name not in model.parameter_names:
            known = ", ".join(model.parameter_names) or "none"
            raise SymbolicError(
                f"parameters: {model.name} has no parameter {name!r}; it has {known}{nearest(name, model.parameter_names)}"
            )
    values = {name: _number(value) for name, value in given.items()}
    for name, value in values.items():
        for symbol in sorted(s.name for s in value.free_symbols):
            if symbol in ("t", *model.inputs) or symbol.startswith(("q.", "u.", "udot.")):
                raise SymbolicError(
                    f"parameters: the value of {name} contains {symbol}, which changes; parameters are constant"
                )
    return values


def _number(value: Any) -> sympy.Expr:
    try:
        found = sympy.sympify(value, strict=True)
    except sympy.SympifyError:
        found = None
    if not isinstance(found, sympy.Expr) or getattr(found, "is_Matrix", False):
        raise SymbolicError(f"{value!r} is neither a number nor an expression of sympy's")
    if isinstance(found, sympy.Float) and np.isfinite(float(found)):
        return exact(float(found))
    if (
        found.is_Float
        or found.is_extended_real is False
        or found.has(sympy.I, sympy.nan, sympy.zoo, sympy.oo, -sympy.oo)
    ):
        raise SymbolicError(f"{value} is not a finite number; finite real numbers and expressions are allowed")
    return found


def _assembled(model: Model, engine: SymbolicEngine, form: str, given: Collection[str]) -> Equations:
    f = engine.free_u
    arrays: dict[str, Any] = {"M": engine.mass[np.ix_(f, f)], "forcing": engine.right_side[f], "qdot": engine.rates}
    more: dict[str, Any] = {}
    if model.loops:
        arrays |= _with_loops(engine, form)
        more["constraints"] = tuple(engine.constraints.names)
    if form == "multipliers":
        more["multipliers"] = symbols_of(engine.constraints.names, "lambda.")
    size = sum(len(x.terms) for of in arrays.values() for x in of.flat)
    if engine.symbolic.algebra.most_products is not None and size > MOST_TERMS:
        raise TooLargeError(f"{size} terms")
    if form == "embedded":
        if not engine.intermediates:  # without intermediate variables, no products are multiplied out
            arrays = {name: matrix_of(of) for name, of in arrays.items()}
        M, S, remainder = arrays["M"], arrays["S"], arrays["remainder"]
        arrays |= {"M": S.T @ M @ S, "forcing": S.T @ (arrays["forcing"] - M @ remainder)}
    dependent = set(engine.dependent.tolist() if form == "embedded" else ())
    independent = tuple(s for s, i in zip(engine.u, f.tolist(), strict=True) if i not in dependent)
    defaults = {s: exact(p.value) for s, p in zip(engine.p, model.parameters, strict=True) if p.name not in given}
    more |= {name: of if isinstance(of, sympy.MatrixBase) else matrix_of(of) for name, of in arrays.items()}
    found = Equations(
        model.name, form, engine.t, engine.q, engine.u, engine.udot, independent, tuple(defaults), engine.inputs,
        **more, outputs=Outputs.of(engine), defaults=defaults | dict.fromkeys(engine.inputs, sympy.Integer(0)),
    )  # fmt: skip
    return _with_definitions(found, engine) if engine.intermediates else found


def _with_definitions(found: Equations, engine: SymbolicEngine) -> Equations:
    """The equations with the definitions of intermediate variables that they contain; these variables are numbered from
    1."""
    algebra, matrices = engine.symbolic.algebra, found.matrices
    every = [(algebra.atoms[number].expression, of) for number, of in algebra.definitions.items()]
    values = needed([*matrices.values(), *found.outputs.values()], every)
    new = dict(zip(values, symbols_of([f"{algebra.intermediate}{n + 1}" for n in range(len(values))]), strict=True))
    changed: dict[str, Any] = {name: of.xreplace(new) for name, of in matrices.items()}
    outputs = Outputs({name: e.xreplace(new) for name, e in found.outputs.items()}, found.outputs.refused)
    definitions = {new[s]: value.xreplace(new) for s, value in values.items()}
    return replace(found, **changed, outputs=outputs, intermediates=definitions)


def _with_loops(engine: SymbolicEngine, form: str) -> dict[str, Array]:
    known, f, held = engine.constraints, engine.free_u, engine.held
    given = engine.state.u.value
    common = {"position": known.position}
    if len(held):
        common["drift"] = known.jacobian[:, held] @ given[held]
    if form == "multipliers":
        return common | {"J": known.jacobian[:, f], "rate": known.remainder}
    dependent = set(engine.dependent.tolist())
    free = [i for i in f.tolist() if i not in dependent]
    motion = engine.motion_of_tree
    if len(held):
        common["s"] = motion[np.ix_(f, held)] @ given[held]
    return common | {"S": motion[np.ix_(f, free)], "remainder": engine.remainder_of_tree[f]}


def _simplified(found: Equations) -> Equations:
    new: dict[str, Any] = {name: of.applyfunc(sympy.simplify) for name, of in found.matrices.items()}
    new["intermediates"] = {s: sympy.simplify(e) for s, e in found.intermediates.items()}
    outputs = Outputs({n: sympy.simplify(e) for n, e in found.outputs.items()}, found.outputs.refused)
    return replace(found, **new, outputs=outputs)


__all__ = ["FORMS", "Equations", "equations"]
