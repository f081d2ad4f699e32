"""Linearised equations of motion: matrices, eigenvalues and modes, and derivatives of the matrices and eigenvalues."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....html_tables import html_of, shapes_of, shapes_text
from ..arrays import Array
from ..warning import warn

Complex = NDArray[np.complex128]

EPS = float(np.finfo(float).eps)

REPEATED = 1e-7
"""Distance of two eigenvalues, relative to the largest eigenvalue, below which they count as repeated."""

ZERO = 3e-7
"""Fraction of the norm of A below which an eigenvalue counts as zero. Rounding errors perturb a double eigenvalue by their
square root."""

NO_NUMBER = complex(np.nan, np.nan)

SPLITS = 1e-9
"""Branches of a repeated eigenvalue count as one if their derivatives differ by less than this fraction of the
largest."""

UNDECIDED = 1e-5
"""Relative error of an eigenvalue above which the sign of its real part is undecided."""


class Matrices(NamedTuple):
    """The matrices of a linearisation, or derivatives of these matrices, with a first axis for k directions.

    Attributes
    ----------
    A : ndarray (2n, 2n)
        Derivatives of the states' rates with respect to the states.
    B : ndarray (2n, ninputs)
        Derivatives of the states' rates with respect to the inputs.
    C : ndarray (m, 2n)
        Derivatives of the outputs with respect to the states.
    D : ndarray (m, ninputs)
        Derivatives of the outputs with respect to the inputs.
    """

    A: Array
    B: Array
    C: Array
    D: Array

    def __repr__(self) -> str:
        return f"<Matrices: {shapes_text(self._asdict().items())}>"

    def _repr_html_(self) -> str:
        return html_of([repr(self)], ("", "shape", "largest"), shapes_of(self._asdict().items()))


MODES_SHOWN = 20
"""Number of modes in a `repr`."""

MATRIX_SHOWN = 12
"""Number of rows and columns of a matrix as HTML."""


class Modes(NamedTuple):
    """Natural motions, one for each real eigenvalue and each complex pair, in the order of their frequencies.

    Attributes
    ----------
    eigenvalues : ndarray of complex (k,)
        Eigenvalues, 1/s; of a pair the one with positive imaginary part.
    frequencies : ndarray (k,)
        Undamped natural frequencies, rad/s: absolute values of the eigenvalues.
    damping : ndarray (k,)
        Damping ratios: minus the real part over the absolute value. 1 for a decay and -1 for a growth without
        oscillation, NaN for a zero eigenvalue.
    shapes : ndarray of complex (k, 2n)
        Eigenvectors of unit length: motions of the states.
    """

    eigenvalues: Complex
    frequencies: Array
    damping: Array
    shapes: Complex

    def __repr__(self) -> str:
        rows = [f"{'rad/s':>12} {'damping':>10} {'eigenvalue, 1/s':>28}"]
        rows += [
            f"{w:12.6g} {z:10.3g} {x.real:13.6g} {x.imag:+13.6g}j"
            for x, w, z in zip(self.eigenvalues[:MODES_SHOWN], self.frequencies, self.damping, strict=False)
        ]
        left = len(self.eigenvalues) - MODES_SHOWN
        return "\n".join([f"Modes: {len(self.eigenvalues)}", *rows, *([f"and {left} more"] if left > 0 else [])])

    def _repr_html_(self) -> str:
        rows = zip(self.frequencies, self.damping, (f"{x:.6g}" for x in self.eigenvalues), strict=True)
        head = ("frequency, rad/s", "damping ratio", "eigenvalue, 1/s")
        return html_of([f"Modes: {len(self.eigenvalues)}"], head, rows, MODES_SHOWN)


class Linearization:
    """The linearised equations ``x' = A x + B du``, ``dy = C x + D du`` about a state.

    `Solver.linearize` returns it.

    Attributes
    ----------
    A : ndarray (2n, 2n)
        Derivatives of the states' rates with respect to the states. The states are n small motions along the
        independent speeds, then n changes of these speeds.
    B : ndarray (2n, ninputs)
        Derivatives of the states' rates with respect to the inputs.
    C : ndarray (m, 2n)
        Derivatives of the m requested outputs with respect to the states.
    D : ndarray (m, ninputs)
        Derivatives of these outputs with respect to the inputs.
    state_names, input_names, output_names : tuple of str
        Names of rows and columns.
    parameter_names : tuple of str
        Names that `sensitivities` and `eigenvalue_sensitivities` take: parameters, and inputs as ``inputs.motor``.
    q, u : ndarray (nq,), (nu,)
        The state, assembled.
    tangents : ndarray (n, nq)
        Change of the coordinates with each small motion.
    at_rest : bool
        Whether the state is an equilibrium.
    """

    def __init__(
        self,
        matrices: Matrices,
        names: tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...], tuple[str, ...]],
        state: tuple[Array, Array, Array],
        at_rest: bool,
        derivatives: Callable[[Sequence[str], bool], Matrices],
    ):
        self.A, self.B, self.C, self.D = matrices
        self.state_names, self.input_names, self.output_names, self.parameter_names = names
        self.q, self.u, self.tangents = state
        self.at_rest = at_rest
        self._derivatives = derivatives

    def __repr__(self) -> str:
        where = "an equilibrium" if self.at_rest else "a state in motion"
        return (
            f"<Linearization about {where}: {len(self.A)} states, {len(self.input_names)} inputs, "
            f"{len(self.output_names)} outputs>"
        )

    def _repr_html_(self) -> str:
        names = self.state_names[:MATRIX_SHOWN]
        rows = ((f"d({name})/dt", *self.A[i, : len(names)]) for i, name in enumerate(names))
        left = len(self.state_names) - len(names)
        more = [f"the first {len(names)} of {len(self.state_names)} states:"] if left else []
        return html_of([repr(self), "A:", *more], ("", *names), rows)

    def eigenvalues(self) -> Complex:
        """Return the eigenvalues of A by increasing absolute value.

        Returns
        -------
        ndarray of complex (2n,)
            Eigenvalues, 1/s. Of a pair the one with negative imaginary part comes first.

        Examples
        --------
        >>> solver.linearize([0.0, 0.0]).eigenvalues().round(3)
        array([-0.001-2.875j, -0.001+2.875j, -0.392-9.086j, -0.392+9.086j])
        """
        return self._solved()[0]

    def modes(self) -> Modes:
        """Return natural frequencies, damping ratios and shapes.

        Returns
        -------
        Modes
            One entry for each real eigenvalue and each complex pair. It prints as a table.

        Examples
        --------
        >>> solver.linearize([0.0, 0.0]).modes().frequencies.round(3)
        array([2.875, 9.095])
        """
        values, right = self._solved()
        kept = values.imag >= 0.0
        values, right = values[kept], right[:, kept]
        size = np.abs(values)
        with np.errstate(all="ignore"):
            damping = np.where(size > 0.0, -values.real / size, np.nan)
        return Modes(values, size, damping, right.T.copy())

    def sensitivities(self, parameters: str | Sequence[str] | None = None, *, moving: bool | None = None) -> Matrices:
        """Return the derivatives of A, B, C and D, exact to rounding.

        Parameters
        ----------
        parameters : str or sequence of str, optional
            Names of parameters, or of inputs as ``inputs.motor``. Default: all parameters.
        moving : bool, optional
            Let the state move with the equilibrium when parameters change, instead of holding its independent
            coordinates and speeds. Default: True at an equilibrium.

        Returns
        -------
        Matrices
            Derivatives with the k directions first: A is (k, 2n, 2n).

        Notes
        -----
        The matrices hold first derivatives of the dynamics, so these are second derivatives. If the package contains
        ``hessian_products`` (and ``output_hessian_products`` for C and D), their C code computes them. If not, the
        statements of the package's NumPy module compute them on dual numbers, which carry derivatives along the k
        parameters through the code for derivatives along the 2n states. There is no step size.

        Examples
        --------
        >>> about_rest = solver.linearize([0.0, 0.0])
        >>> about_rest.sensitivities("stiffness").A[0, 2:, :2].round(3)
        array([[  0.   ,   3.828],
               [  0.   , -15.687]])
        """
        asked = self.parameter_names[: self._parameters] if parameters is None else parameters
        return self._derivatives(
            [asked] if isinstance(asked, str) else list(asked), self.at_rest if moving is None else moving
        )

    def eigenvalue_sensitivities(
        self, parameters: str | Sequence[str] | None = None, *, moving: bool | None = None
    ) -> Complex:
        """Return the derivatives of the eigenvalues with respect to parameters.

        Parameters
        ----------
        parameters : str or sequence of str, optional
            Names of parameters, or of inputs as ``inputs.motor``. Default: all parameters.
        moving : bool, optional
            See `sensitivities`.

        Returns
        -------
        ndarray of complex (k, 2n)
            Derivatives in the order of `eigenvalues`.

        Warns
        -----
        RuntimeWarning
            If a repeated eigenvalue splits into branches with different derivatives, or has too few eigenvectors. With
            too few eigenvectors, the derivative is NaN in both parts.

        Notes
        -----
        With left and right eigenvectors y and x the derivative is ``y^H dA x / (y^H x)``. An m-fold eigenvalue with m
        right eigenvectors (columns of X) and m left ones (rows of Y) splits into m branches when one parameter changes.
        The derivatives of its branches are the eigenvalues of ``(Y X)^-1 Y dA X``, in the order of their real, then
        imaginary parts.

        Examples
        --------
        >>> solver.linearize([0.0, 0.0]).eigenvalue_sensitivities("length_1").round(3)
        array([[0.001+0.974j, 0.001-0.974j, 0.19 +1.783j, 0.19 -1.783j]])
        """
        # long: the docstring derives the formula
        dA = self.sensitivities(parameters, moving=moving).A
        values, right = self._solved()
        repeated = _repeated(self.A, values, right)
        found = np.full((len(dA), len(values)), NO_NUMBER)
        if not repeated.all():
            # the eigenvectors of a defective A form a singular matrix; only simple eigenvalues are needed
            left = _left(self.A, values)
            of_left = np.einsum("ij,jk->ik", left, right).diagonal()
            with np.errstate(all="ignore"):
                found = np.einsum("ia,kab,bi->ki", left, dA, right) / of_left
        if repeated.any():
            split, defective = [], []
            for places in _clusters(self.A, values, repeated):
                of = _derivatives_of_branches(self.A, values[places], dA)
                found[:, places] = NO_NUMBER if of is None else of
                if of is None:
                    defective.append(values[places[0]])
                elif np.abs(of - of.mean(axis=1, keepdims=True)).max(initial=0.0) > SPLITS * np.abs(of).max(
                    initial=0.0
                ):
                    split.append(values[places[0]])
            if defective:
                some = ", ".join(f"{x:.4g}" for x in defective[:6])
                warn(
                    f"eigenvalues {some} are repeated, to rounding, with too few eigenvectors: their derivatives are NaN"
                )
            if split:
                some = ", ".join(f"{x:.4g}" for x in split[:6])
                warn(
                    f"eigenvalues {some} are repeated, to rounding: derivatives are those of their branches along each "
                    f"parameter alone, and must not be added over several parameters"
                )
        return found

    @property
    def _parameters(self) -> int:
        return sum(not name.startswith("inputs.") for name in self.parameter_names)

    def _solved(self) -> tuple[Complex, Complex]:
        """Sorted eigenvalues, and their right eigenvectors as columns."""
        values, right = np.linalg.eig(self.A)
        values, right = values.astype(complex), right.astype(complex)
        scale = np.abs(values).max(initial=0.0)
        order = np.lexsort((values.imag, np.round(np.abs(values) / (scale or 1.0), 9)))
        return values[order], right[:, order]


def _left(A: Array, values: Complex) -> Complex:
    """Left eigenvectors y^H of the eigenvalues, as rows."""
    found, vectors = np.linalg.eig(A.T)
    found, vectors = found.astype(complex), vectors.astype(complex)
    rows, left = np.empty((len(values), len(values)), complex), list(range(len(found)))
    for i, value in enumerate(values):
        nearest = min(left, key=lambda j: abs(found[j] - value))
        left.remove(nearest)
        rows[i] = vectors[:, nearest]  # a right eigenvector of A^T is y^H of A
    return rows


def _clusters(A: Array, values: Complex, repeated: NDArray[np.bool_]) -> list[NDArray[np.intp]]:
    """Groups of indices of equal eigenvalues."""
    left, found = np.flatnonzero(repeated), []
    while len(left):
        same = np.abs(values[left] - values[left[0]]) <= 4 * REPEATED * np.abs(values).max(initial=0.0)
        found.append(left[same])
        left = left[~same]
    return found


def _derivatives_of_branches(A: Array, values: Complex, dA: Array) -> Complex | None:
    """Derivatives (k, m) of the branches of an m-fold eigenvalue; None if it has fewer than m eigenvectors."""
    m = len(values)
    shifted = A - values.mean() * np.eye(len(A))
    left, size, right = np.linalg.svd(shifted)
    if not size[-m] <= 1e3 * REPEATED * max(size[0], float(np.abs(A).max())):
        return None
    X, Y = right[-m:].conj().T, left[:, -m:].conj().T
    both = Y @ X
    if np.linalg.svd(both, compute_uv=False)[-1] < np.sqrt(REPEATED):
        return None
    found = np.linalg.eigvals(np.linalg.solve(both, Y @ dA @ X))
    sign = 1.0 if values[0].imag >= 0.0 else -1.0  # keeps the order of complex conjugate eigenvalues
    order = np.lexsort((sign * found.imag, np.round(found.real, 12)), axis=-1)
    return np.take_along_axis(found, order, axis=-1).astype(complex)


def _repeated(A: Array, values: Complex, right: Complex) -> NDArray[np.bool_]:
    """Whether an eigenvalue equals another one up to rounding."""
    apart = np.abs(values[:, None] - values[None, :])
    np.fill_diagonal(apart, np.inf)
    return apart.min(axis=1, initial=np.inf) <= REPEATED * np.abs(values).max(initial=0.0)


def is_stable(A: Array, neutral: int) -> bool | None:
    """Whether small motions by ``x' = A x`` remain bounded; None if rounding or a drift along neutral directions leaves this
    open.

    Parameters
    ----------
    A : (2n, 2n)
    neutral : int
        Number of neutral directions, along which any displacement is an equilibrium.
    """
    n = len(A) // 2
    if not n:
        return True
    # a unit of time in which speeds and displacements have the same magnitude
    scale = np.repeat([1.0, float(np.sqrt(np.abs(A[n:, :n]).max())) or 1.0], n)
    scaled = A * scale / scale[:, None]
    values, right = np.linalg.eig(scaled)
    try:
        with np.errstate(all="ignore"):  # the matrix of eigenvectors may be nearly singular
            condition = np.linalg.norm(np.linalg.inv(right), axis=1) * np.linalg.norm(right, axis=0)
    except np.linalg.LinAlgError:
        condition = np.full(2 * n, np.inf)
    largest = float(np.linalg.norm(scaled, 2))
    error = 16.0 * n * EPS * largest * np.nan_to_num(condition, nan=np.inf, posinf=np.inf)
    zero = np.abs(values) <= ZERO * largest
    if np.any((values.real > error) & ~zero):
        return False
    open_ = (error > UNDECIDED * largest) & (values.real > -error) & ~zero
    return None if open_.any() or np.count_nonzero(zero) > neutral else True
