"""`Solver`: every function of a generated solver, with what it takes and returns.

Most methods call one function of the generated code by `Package._call`. Methods that combine several functions delegate to
classes in the folders beside this file. A package contains only the sections of this class that its functions need. Comments
``-- name --`` mark the sections, and `codegen.runtime.sections` lists the functions that need them.
"""
# long: each of fifty methods has a signature and a docstring

from __future__ import annotations

import functools
import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .arrays import Array, Numbers, Times
from .assembly.partitions import conditions, partition_names, use_partition
from .assembly.states import States
from .calls.package import Composed, Package
from .display.viewer import Viewer
from .display.views import Views
from .motion.controllers import take_controller
from .motion.functional_gradients import MEMORY, FunctionalGradients
from .motion.functionals import Functional, Judged
from .motion.ode import Ode
from .motion.run import Progress
from .motion.settings import ATOL, METHOD, MOST_STEPS, RTOL, Settings, Start
from .state.derivatives import Gradients, HessianProducts, InverseDynamicsProducts, Jacobians
from .state.frame_motion import FrameMotion, PointMotion
from .state.frames import Bodies, Frames, Points
from .state.hessians import Hessians
from .state.jacobians import jacobians
from .state.reactions import JointLinks, joint_links, reaction_sensitivities_of, reactions_of
from .state.weighted_gradients import WeightedGradients
from .statics.curvature import EquilibriumProducts, equilibrium_products
from .statics.equilibrium import Equilibrium
from .statics.linearization import Linearization
from .statics.statics import Statics
from .trajectory.trajectory import Trajectory
from .trust.diagnose import Diagnosing
from .trust.diagnosis import Diagnosis
from .trust.precision import PartitionModules, extended


class Solver(Package):
    """A generated solver, which evaluates one model and its exact derivatives.

    Several threads may use one solver at once.

    Parameters
    ----------
    folder : path
        The generated package.
    target : {"c", "numpy", "both"}, optional
        The code that computes. Default: the target that the package was generated for. With "both", loading compares
        the two first; then the C code computes. Without a C compiler the NumPy module computes, and a warning says so.

    Raises
    ------
    PackageError
        If the folder holds no generated package, or a damaged one.
    CompileError
        If the compiler fails.
    TargetsDifferError
        If `target` is "both" and the two targets disagree.

    See Also
    --------
    codegen.runtime.load : Opens a package.

    Notes
    -----
    Methods take SI units and radians: coordinates ``q (..., nq)``, speeds ``u (..., nu)``, design parameters
    ``p (..., np)`` (default: `parameters`), ``inputs (..., ninputs)`` (default: zeros) and time ``t (...)``. Leading axes
    are batch axes and broadcast by NumPy's rules.

    Seeds have their k directions first: ``dq (k, ..., nq)``, ``du``, ``dp`` and ``dinputs`` likewise, ``dt (k, ...)``. A
    seed without this axis counts as k = 1; missing seeds are zero. Results are (..., n), derivatives (k, ..., n). Each of
    these arguments except t may be a mapping from names to numbers.

    Every method raises ValueError for a wrong shape, an unknown name, a number that is not finite, and a quaternion shorter
    than 1e-6. Methods that solve for accelerations raise `SingularJointError`.

    Examples
    --------
    The examples of the methods use three solvers of models in ``examples``: `solver` of the double pendulum, `four_bar` of
    the four-bar linkage and `shaken` of the pendulum whose table has a prescribed motion.

    >>> solver
    <Solver double_pendulum: nq=2, nu=2, np=6, ninputs=0, noutputs=6, target=numpy>
    >>> solver.parameter_names
    ('length_1', 'length_2', 'mass_1', 'mass_2', 'stiffness', 'damping')
    """

    def _is_opened(self) -> None:
        if "moved_initial" in self._manifest:
            from .assembly.open_states import warn_of_moved_initial

            warn_of_moved_initial(self)

    def _is_used(self) -> None:
        if self._watched or self._opened.manifest.get("dropped"):
            from .assembly.redundancy import Redundancy

            of_redundancy = Redundancy(self)
            of_redundancy.watch_calls()
            self._watch = of_redundancy.look_at_directions
        self._looks_at_state = []
        if self.closure_names:
            from .assembly.open_states import OpenStates

            self._looks_at_state.append(OpenStates(self).look)
        if "masses" in self._manifest:
            from .state.negative_masses import NegativeMasses

            self._masses = NegativeMasses(self)
            self._looks_at_state.append(self._masses.look)
        if "scalar" in self._manifest and "assemble" not in self.__dict__:
            from .trust.single_precision import InDouble

            InDouble(self).put_in_place()

    # -- dynamics ------------------------------------------------------------------------------------------------------

    def accelerations(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        out: Array | None = None,
    ) -> Array:  # fmt: skip
        """Return the derivatives of the speeds (Eqs. 18-24 and 42-56).

        Parameters
        ----------
        q, u : array_like (..., nq), (..., nu)
            Coordinates and speeds, SI units and radians.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        out : ndarray, optional
            Array for the result. It is returned.

        Returns
        -------
        ndarray (..., nu)
            udot, rad/s^2 or m/s^2.

        Raises
        ------
        SingularJointError
            If nothing outboard of a joint has inertia along it, or a loop has lost rank.

        Examples
        --------
        >>> q, u = solver.initial
        >>> solver.accelerations(q, u).round(3)
        array([-15.414,  32.58 ])
        >>> solver.accelerations(q, u, {"mass_2": 2.0}).round(3)
        array([-14.334,  27.759])
        >>> solver.accelerations(np.tile(q, (100, 1)), u).shape
        (100, 2)
        """
        return self._call("accelerations", (q, u, p, inputs, t), None, out)[0]

    def sensitivities(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None,
        out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """Return udot and its total derivatives along seeds (Eqs. 9, 10), exact to rounding.

        Parameters
        ----------
        q, u : array_like (..., nq), (..., nu)
            Coordinates and speeds, SI units and radians.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        dq, du, dp, dinputs, dt : array_like (k, ..., nq), (k, ..., nu), ..., optional
            Seeds, at least one: k directions of change of the arguments. Those left out are zero.
        out : tuple of two ndarray, optional
            Arrays for value and derivative. They are returned.

        Returns
        -------
        udot : ndarray (..., nu)
            Derivatives of the speeds, rad/s^2 or m/s^2.
        dudot : ndarray (k, ..., nu)
            Their derivative along each direction.

        See Also
        --------
        jacobians : Partial derivatives with respect to everything.
        gradients : Gradients of sums of udot, at a cost that does not grow with the number of parameters.

        Examples
        --------
        >>> q, u = solver.initial
        >>> udot, dudot = solver.sensitivities(q, u, dp={"length_1": 1.0})
        >>> dudot.round(3)
        array([[ 16.333, -17.918]])
        >>> solver.sensitivities(q, u, dq=np.eye(2))[1].shape
        (2, 2)
        """
        return self._call("sensitivities", (q, u, p, inputs, t), (dq, du, dp, dinputs, dt), out)

    def jacobians(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        wrt: str | Sequence[str] | None = None, out: Jacobians | None = None,
    ) -> Jacobians:  # fmt: skip
        """Return the partial derivatives of udot.

        In mechanisms with loops the columns of dependent coordinates and speeds are zero: the columns of the independent ones
        contain the effect of the dependent ones.

        Parameters
        ----------
        q, u : array_like (..., nq), (..., nu)
            Coordinates and speeds, SI units and radians.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        wrt : str or sequence of str, optional
            Variables of differentiation, such as ``"q, u"``. Default: q, u, p, inputs and t.
        out : Jacobians, optional
            Result of an earlier call, whose arrays are used again.

        Returns
        -------
        Jacobians
            `q` (..., nu, nq), `u`, `p`, `inputs`, and `t` (..., nu). Those that `wrt` does not name are None.

        Examples
        --------
        >>> q, u = solver.initial
        >>> J = solver.jacobians(q, u, wrt="q, u")
        >>> J.q.round(3)
        array([[ -1.738,   3.879],
               [ -8.069, -21.501]])
        >>> J.p is None
        True
        """
        return jacobians(self, (q, u, p, inputs, t), wrt, out)

    def coordinate_rates(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        out: Array | None = None,
    ) -> Array:  # fmt: skip
        """Return the time derivatives of the coordinates (Eq. 1).

        They differ from u for quaternions, and for positions of free joints.

        Parameters
        ----------
        q, u : array_like (..., nq), (..., nu)
            Coordinates and speeds, SI units and radians.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        out : ndarray, optional
            Array for the result. It is returned.

        Returns
        -------
        ndarray (..., nq)
            qdot, rad/s or m/s; 1/s for quaternions.

        Examples
        --------
        >>> q, u = solver.initial
        >>> solver.coordinate_rates(q, [0.5, -1.0])
        array([ 0.5, -1. ])
        """
        return self._call("coordinate_rates", (q, u, p, inputs, t), None, out)[0]

    def coordinate_rate_sensitivities(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None,
        out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """Return qdot and its total derivatives along seeds.

        Parameters
        ----------
        q, u : array_like (..., nq), (..., nu)
            Coordinates and speeds, SI units and radians.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        dq, du, dp, dinputs, dt : array_like (k, ..., nq), (k, ..., nu), ..., optional
            Seeds, at least one: k directions of change of the arguments. Those left out are zero.
        out : tuple of two ndarray, optional
            Arrays for value and derivative. They are returned.

        Returns
        -------
        qdot : ndarray (..., nq)
            Time derivatives of the coordinates.
        dqdot : ndarray (k, ..., nq)
            Their derivative along each direction.

        Examples
        --------
        >>> q, u = solver.initial
        >>> qdot, dqdot = solver.coordinate_rate_sensitivities(q, u, du=np.eye(2))
        >>> dqdot
        array([[1., 0.],
               [0., 1.]])
        """
        return self._call("coordinate_rate_sensitivities", (q, u, p, inputs, t), (dq, du, dp, dinputs, dt), out)

    # -- consistent states ---------------------------------------------------------------------------------------------

    @property
    def initial(self) -> tuple[Array, Array]:
        """The model's initial state (q, u) at the default parameters, assembled."""
        return self.initial_state()

    def initial_state(self, p: Numbers = None) -> tuple[Array, Array]:
        """Return the model's initial state at given parameters, assembled.

        Initial values may be expressions of parameters. For a model that starts in equilibrium, this is the equilibrium
        that the initial values lead to, at zero inputs and t = 0.

        Parameters
        ----------
        p : array_like (..., np), optional
            Parameters. Default: the default parameters.

        Returns
        -------
        q : ndarray (..., nq)
            Coordinates, with closed loops and quaternions of length one.
        u : ndarray (..., nu)
            Speeds, consistent with the loops.

        Raises
        ------
        AssemblyError
            If a loop cannot be closed at these parameters.

        Examples
        --------
        >>> q, u = four_bar.initial_state({"base": 1.2})
        >>> q.round(3)
        array([ 0.8  , -0.271, -2.228])
        """
        return self._states.initial_state(p)

    def initial_sensitivities(self, p: Numbers = None, *, dp: Numbers) -> tuple[Array, Array, Array, Array]:
        """Return the state of `initial_state` and its derivatives with respect to parameters.

        The derivatives include those of initial values that are expressions of parameters, and keep loops closed.

        Parameters
        ----------
        p : array_like (..., np), optional
            Parameters. Default: the default parameters.
        dp : array_like (k, ..., np)
            Seeds.

        Returns
        -------
        q, u : ndarray (..., nq), (..., nu)
            The initial state.
        dq, du : ndarray (k, ..., nq), (k, ..., nu)
            Its derivative along each direction.

        Examples
        --------
        >>> q, u, dq, du = four_bar.initial_sensitivities(dp={"base": 1.0})
        >>> dq.round(3)
        array([[0.   , 0.291, 1.052]])
        """
        return self._states.initial_sensitivities(p, dp)

    def assemble(
        self, q: Numbers = None, u: Numbers = None, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        follow: bool | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """Return a consistent state: loops closed, quaternions of unit length.

        Loops stay on the branch of the guess. A guess far from a closed state may have the dependent coordinates of a state
        that is closed at other independent coordinates, or at another time. Assembly then follows the loops from that state
        along a straight line to the guess. It follows the initial state likewise, from the default parameters and t = 0.

        Parameters
        ----------
        q, u : array_like (..., nq), (..., nu), optional
            The guess: independent entries are kept, dependent ones are changed. Default: the model's initial state.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        follow : bool, optional
            Treat the states along the last batch axis as a path: each state is followed from the state before it, the
            first from its guess. Default: True along the axis of t where motion is prescribed and all times share one
            guess.

        Returns
        -------
        q : ndarray (..., nq)
            Coordinates.
        u : ndarray (..., nu)
            Speeds.

        Raises
        ------
        AssemblyError
            If a loop cannot be closed, or its branch ends on the way. The error names the loop and the residual.

        Warns
        -----
        RuntimeWarning
            If the branch is in doubt: a loop loses rank on the way, or the guess is far from any closed state.

        See Also
        --------
        closure : Residuals of the loops.

        Examples
        --------
        >>> q, u = four_bar.assemble({"crank": 1.2})
        >>> q.round(3)
        array([ 1.2  , -0.754, -2.159])
        >>> q, u = four_bar.assemble({"crank": np.linspace(0.8, 7.0, 100)}, follow=True)
        >>> q.shape
        (100, 3)
        """
        return self._states.assemble(q, u, p, inputs, t, follow)

    def assemble_sensitivities(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None,
        follow: bool | None = None,
    ) -> tuple[Array, Array, Array, Array]:  # fmt: skip
        """Return a consistent state and its derivatives along seeds.

        Only the independent entries of dq and du are read; closure determines the dependent ones.

        Parameters
        ----------
        q, u : array_like (..., nq), (..., nu)
            The guess: independent entries are kept, dependent ones are changed.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        dq, du, dp, dinputs, dt : array_like (k, ..., nq), (k, ..., nu), ..., optional
            Seeds, at least one: k directions of change of the arguments. Those left out are zero.
        follow : bool, optional
            See `assemble`.

        Returns
        -------
        q, u : ndarray (..., nq), (..., nu)
            The assembled state.
        dq, du : ndarray (k, ..., nq), (k, ..., nu)
            Its derivative along each direction, with the dependent entries.

        Raises
        ------
        AssemblyError
            If a loop cannot be closed.

        Examples
        --------
        >>> q, u = four_bar.initial
        >>> q, u, dq, du = four_bar.assemble_sensitivities(q, u, dq={"crank": 1.0})
        >>> dq.round(3)
        array([[ 1.   , -1.228,  0.404]])
        """
        return self._states.assemble_sensitivities((q, u, p, inputs, t), (dq, du, dp, dinputs, dt), follow)

    def closure(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0
    ) -> tuple[Array, Array]:
        """Return the scaled residuals of the loops in position and velocity.

        Residuals of linear conditions are divided by the loop's characteristic length. All entries of u are used as they
        are passed, also the dependent ones.

        Parameters
        ----------
        q, u : array_like (..., nq), (..., nu)
            Coordinates and speeds, SI units and radians.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.

        Returns
        -------
        position : ndarray (..., nclosure)
            One residual for each of `closure_names`; rad for angular conditions.
        velocity : ndarray (..., nclosure)
            Time derivatives of the residuals, 1/s.

        Examples
        --------
        >>> q, u = four_bar.initial
        >>> position, velocity = four_bar.closure(q, u)
        >>> bool(np.abs(position).max() < 1e-12)
        True
        """
        return self._call("closure", (q, u, p, inputs, t))

    def closure_sensitivities(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """Return the position residuals of the loops and their total derivatives along seeds.

        Dependent entries of the seeds follow from closure. The derivatives are then zero to rounding, unless a direction
        breaks redundant conditions, such as a parameter that bends a planar loop out of its plane. No derivative of the
        motion exists along such a direction.

        Parameters
        ----------
        q, u : array_like (..., nq), (..., nu)
            Coordinates and speeds, SI units and radians.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        dq, du, dp, dinputs, dt : array_like (k, ..., nq), (k, ..., nu), ..., optional
            Seeds, at least one: k directions of change of the arguments. Those left out are zero.

        Returns
        -------
        position : ndarray (..., nclosure)
            One scaled residual for each of `closure_names`.
        dposition : ndarray (k, ..., nclosure)
            Their derivative along each direction.

        Examples
        --------
        >>> q, u = four_bar.initial
        >>> position, dposition = four_bar.closure_sensitivities(q, u, dp={"base": 1.0})
        >>> bool(np.abs(dposition).max() < 1e-12)
        True
        """
        return self._call("closure_sensitivities", (q, u, p, inputs, t), (dq, du, dp, dinputs, dt))

    @functools.cached_property
    def _states(self) -> States:
        """Assembles consistent states; closes the loops in mechanisms."""
        kind = States
        if self.closure_names:
            from .assembly.loops import Loops

            kind = Loops
        return kind(self, lambda q, p, sensitivities: self.equilibrium(q, p, sensitivities=sensitivities))

    def _left_out(self, name: str, given: Mapping[str, Any]) -> Array | float:
        if name not in ("q", "u"):
            return super()._left_out(name, given)
        return self._states.left_out(given, self.initial_state)[name == "u"]

    # -- partitions ----------------------------------------------------------------------------------------------------

    @property
    def partitions(self) -> tuple[tuple[str, ...], ...]:
        """Names of the independent coordinates of each partition in the package, one to four."""
        return partition_names(self)

    @property
    def partition(self) -> int:
        """Number of the partition in use, from 0."""
        return self._opened.number

    def use_partition(self, partition: int) -> None:
        """Use another choice of independent coordinates from now on.

        States keep their meaning, since q and u hold all coordinates and speeds. Do not call this while other threads use the
        solver.

        Parameters
        ----------
        partition : int
            Index in `partitions`.

        Raises
        ------
        ValueError
            If there is no such partition.

        Examples
        --------
        >>> four_bar.partitions
        (('crank',), ('coupler',))
        >>> four_bar.use_partition(1)
        >>> four_bar.independent_names
        ('coupler',)
        >>> four_bar.use_partition(0)
        """
        use_partition(self, partition)

    def condition(self, q: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0) -> Array:
        """Return the worst condition number of the closure matrices, for each partition.

        The closure matrix A has a column for each of n dependent speeds. Its condition number is 1 at best, and infinite
        where a loop has lost rank, as at a dead point of the independent coordinates. It measures the change of dependent
        speeds per unit of a residual: ``|A^-1| max(|A|, sqrt(n))/n`` in the Frobenius norm, and ``1/|A|`` if n = 1. The unit
        of length is the characteristic length. Other threads may use the solver meanwhile.

        Parameters
        ----------
        q : array_like (..., nq)
            Coordinates, SI units and radians.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.

        Returns
        -------
        ndarray (..., npartitions)
            Condition numbers, in the order of `partitions`.

        Examples
        --------
        >>> q, u = four_bar.initial
        >>> four_bar.condition(q).round(2)
        array([1.13, 1.05])
        """
        return conditions(self, q, p, inputs, t)

    # -- statics -------------------------------------------------------------------------------------------------------

    def equilibrium(
        self, q: Numbers = None, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        sensitivities: str | Sequence[str] = (), relax: bool = False, tolerance: float = 1e-9,
    ) -> Equilibrium:  # fmt: skip
        """Find an equilibrium near a guess: u = 0 and udot = 0.

        Newton's method with exact Jacobians finds the equilibrium that the guess leads to, stable or not. If it
        fails, the mechanism relaxes from the guess as in a viscous medium. If all forces have a potential, the
        equilibrium found by relaxation is stable. Forces are evaluated at u = 0 and time t. Steady rotation is not an
        equilibrium.

        Parameters
        ----------
        q : array_like (nq,), optional
            The guess. Default: the model's initial coordinates. Dependent ones follow from closure.
        p, inputs, t : array_like (np,), (ninputs,), float, optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        sensitivities : str or sequence of str, optional
            Parameters, and inputs as ``inputs.motor``, with respect to which q is differentiated.
        relax : bool, optional
            Relax the mechanism first. The equilibrium is then stable if all forces have a potential, but may
            not be the nearest one.
        tolerance : float, optional
            Largest acceleration of an equilibrium, rad/s^2 or m/s^2, relative to 1 plus the acceleration that a
            displacement of 1 rad or 1 m would cause. Newton's method continues below the tolerance while steps help.

        Returns
        -------
        Equilibrium
            q, u, dq, stable, neutral and the residual. Near a loss of rank of a loop a warning is issued and `stable`
            is None.

        Raises
        ------
        EquilibriumError
            If no equilibrium is found. It names the coordinate with the largest acceleration.
        AssemblyError
            If the guess cannot be closed.

        See Also
        --------
        linearize : Linearised equations about a state.

        Examples
        --------
        >>> rest = solver.equilibrium({"upper": 0.3}, sensitivities="length_1")
        >>> np.abs(rest.q).round(6), rest.stable
        (array([0., 0.]), True)
        """
        return self._statics.equilibrium(q, p, inputs, t, sensitivities, relax, tolerance)

    def linearize(
        self, q: Numbers = None, u: Numbers = None, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        outputs: str | Sequence[str] | None = None,
    ) -> Linearization:  # fmt: skip
        """Return the linearised equations of motion about a state, exact to rounding.

        They are ``x' = A x + B dinputs`` and ``dy = C x + D dinputs``. The state x holds n small motions w along the
        independent speeds (``q.crank`` in ``state_names``), then n changes v of these speeds (``u.crank``). Small
        motions of quaternions are small rotations about the axes of their speeds (``rotation.ball.wx``), and small
        motions of the positions of free joints are along the axes of their speeds (``displacement.bus.vx``): ``dq = N
        w`` where ``qdot = N u``. So A has no superfluous rows. Dependent coordinates and speeds follow from closure.

        Parameters
        ----------
        q : array_like (nq,), optional
            Coordinates. Default: the model's initial ones. Dependent ones follow from closure.
        u : array_like (nu,), optional
            Speeds. Default: zeros.
        p, inputs, t : array_like (np,), (ninputs,), float, optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        outputs : str or sequence of str, optional
            Outputs y in C and D. Default: all, if the package has their derivatives.

        Returns
        -------
        Linearization
            A, B, C, D with names; eigenvalues, modes, and derivatives with respect to parameters.

        Raises
        ------
        AssemblyError
            If the state cannot be closed.

        Notes
        -----
        Differentiating ``qdot = N u`` along a motion gives (D is the derivative with respect to q)

            w' = v + N^+ (D(N u)[N w] - D(N w)[N u])        v' = D udot[N w] + (d udot/du) v

        At rest w' = v. In motion the term N^+ (...) is not zero for quaternions and free joints, whose axes turn with the
        body: for a rotation w' = v + w x u. About a moving state, A and all forces that depend on t are evaluated at the
        time t.

        Examples
        --------
        >>> about_rest = solver.linearize([0.0, 0.0])
        >>> about_rest.state_names
        ('q.upper', 'q.lower', 'u.upper', 'u.lower')
        >>> about_rest.eigenvalues().imag.round(3)
        array([-2.875,  2.875, -9.086,  9.086])
        """
        return self._statics.linearize(q, u, p, inputs, t, outputs)

    @functools.cached_property
    def _statics(self) -> Statics:
        return Statics(self, self._states)

    # -- first-order equations -----------------------------------------------------------------------------------------

    def ode(
        self, q: Numbers = None, u: Numbers = None, p: Numbers = None, inputs: Any = None, t: float = 0.0
    ) -> Ode:  # fmt: skip
        """Return the equations of motion as ``y' = f(t, y)``, with exact Jacobian, for integrators such as SciPy's `solve_ivp`.

        y holds the independent coordinates, then the independent speeds; loops stay closed. `simulate` is faster, locates the
        times at which forces jump, and changes the independent coordinates near dead points.

        Parameters
        ----------
        q, u : array_like (nq,), (nu,), optional
            The initial state. Dependent entries follow from closure. Default: the model's initial state.
        p : array_like (np,), optional
            Parameters. Default: the default parameters.
        inputs : array_like (nsignals,), tuple, callable, spline or mapping, optional
            Inputs over time, as in `simulate`. A function of time is called at each evaluation.
        t : float, optional
            Time of the initial state, s.

        Returns
        -------
        Ode
            A function ``ode(t, y)`` with `initial`, `jacobian(t, y)`, `parameter_jacobian(t, y)` and `state(t, y)`.

        Raises
        ------
        AssemblyError
            If the initial state cannot be closed.

        Examples
        --------
        >>> from scipy.integrate import solve_ivp
        >>> ode = four_bar.ode()
        >>> ode.names
        ('q.crank', 'u.crank')
        >>> found = solve_ivp(ode, (0.0, 0.5), ode.initial, method="Radau", jac=ode.jacobian, rtol=1e-8, atol=1e-8)
        >>> q, u = ode.state(found.t, found.y)
        >>> np.abs(four_bar.closure(q, u)[0]).max() < 1e-12
        np.True_
        """
        return Ode(self, self._states, q, u, p, inputs, t)

    # -- diagnosis -----------------------------------------------------------------------------------------------------

    def diagnose(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None, derivatives: bool = True,
    ) -> Diagnosis:  # fmt: skip
        """Estimate rounding errors and conditions at one state.

        The code itself gives the estimates: it runs once with every operation rounded up, and once rounded down. So the
        estimates follow the algorithm; no condition number bounds its errors in general. In most cases they are right
        within a factor of 30 (docs/theory.md, section 9). Errors of the arguments are not included: `argument_error`
        shows the effect of a unit in their last places.

        Parameters
        ----------
        q, u : array_like (nq,), (nu,)
            One state. It is not assembled: `gap` reports how far loops are open.
        p, inputs, t : array_like (np,), (ninputs,), float, optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        dq, du, dp, dinputs, dt : array_like (k, nq), (k, nu), ..., optional
            Seeds of the derivatives. Default: each independent coordinate and speed, parameter, input and t by itself.
        derivatives : bool, optional
            Whether to estimate the errors of derivatives.

        Returns
        -------
        Diagnosis
            Prints as text. A state at which rank is lost has a diagnosis too; it is not an error.

        Examples
        --------
        >>> found = solver.diagnose(*solver.initial)
        >>> bool(found.digits.min() > 12)
        True
        """
        return self._diagnoses.diagnose((q, u, p, inputs, t), (dq, du, dp, dinputs, dt), derivatives)

    @functools.cached_property
    def _diagnoses(self) -> Diagnosing:
        return Diagnosing(self)

    # -- weighted gradients --------------------------------------------------------------------------------------------

    def gradients(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, weights: Numbers
    ) -> Gradients:
        """Return gradients of ``sum_i weights_i udot_i``, exact to rounding.

        They are ``weights^T J`` for the Jacobians J of udot with respect to all arguments, computed in reverse mode. The
        cost does not grow with the number of parameters.

        Parameters
        ----------
        q, u : array_like (..., nq), (..., nu)
            Coordinates and speeds, SI units and radians.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        weights : array_like (k, ..., nu)
            Weights of the entries of udot in each of k sums; (nu,) for one sum.

        Returns
        -------
        Gradients
            `q` (k, ..., nq), `u`, `p`, `inputs` and `t` (k, ...).

        Examples
        --------
        >>> q, u = solver.initial
        >>> solver.gradients(q, u, weights={"lower": 1.0}).p.round(3)
        array([[-17.918, -31.526,  -1.793,  -7.936,   5.313,   0.   ]])
        """
        return self._gradients.of("sensitivities_transposed", (q, u, p, inputs, t), (weights,))

    def coordinate_rate_gradients(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, weights: Numbers
    ) -> Gradients:
        """Return gradients of weighted sums of the time derivatives of the coordinates.

        Parameters
        ----------
        q, u : array_like (..., nq), (..., nu)
            Coordinates and speeds, SI units and radians.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        weights : array_like (k, ..., nq)
            Weights of the entries of qdot in each of k sums; (nq,) for one sum.

        Returns
        -------
        Gradients
            `q` (k, ..., nq), `u`, `p`, `inputs` and `t` (k, ...).

        Examples
        --------
        >>> q, u = solver.initial
        >>> solver.coordinate_rate_gradients(q, u, weights=[1.0, 2.0]).u
        array([[1., 2.]])
        """
        return self._gradients.of("coordinate_rate_sensitivities_transposed", (q, u, p, inputs, t), (weights,))

    def energy_gradients(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, weights: Numbers
    ) -> Gradients:
        """Return gradients of weighted sums of kinetic and potential energy.

        Parameters
        ----------
        q, u : array_like (..., nq), (..., nu)
            Coordinates and speeds, SI units and radians.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        weights : array_like (k, ..., 2)
            Weights of kinetic and potential energy in each of k sums; (2,) for one sum.

        Returns
        -------
        Gradients
            `q` (k, ..., nq), `u`, `p`, `inputs` and `t` (k, ...).

        Examples
        --------
        >>> q, u = solver.initial
        >>> solver.energy_gradients(q, u, weights=[1.0, 1.0]).q.round(3)
        array([[18.816,  2.815]])
        """
        return self._gradients.of("energy_sensitivities_transposed", (q, u, p, inputs, t), (weights,))

    def output_gradients(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, weights: Numbers
    ) -> Gradients:
        """Return gradients of weighted sums of the model's outputs.

        Outputs of weight zero are skipped: an infinite derivative of such an output has no effect.

        Parameters
        ----------
        q, u : array_like (..., nq), (..., nu)
            Coordinates and speeds, SI units and radians.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        weights : array_like (k, ..., noutputs)
            Weights of the outputs in each of k sums; (noutputs,) for one sum.

        Returns
        -------
        Gradients
            `q` (k, ..., nq), `u`, `p`, `inputs` and `t` (k, ...).

        Examples
        --------
        >>> q, u = solver.initial
        >>> solver.output_gradients(q, u, weights={"tip_x": 1.0}).q.round(3)
        array([[-0.92 , -0.557]])
        """
        return self._gradients.of("output_sensitivities_transposed", (q, u, p, inputs, t), (weights,))

    def assemble_gradients(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        weights_q: Numbers = None, weights_u: Numbers = None,
    ) -> Gradients:  # fmt: skip
        """Return gradients of weighted sums of the assembled state with respect to all arguments.

        Parameters
        ----------
        q, u : array_like (..., nq), (..., nu)
            The guess: independent entries are kept, dependent ones are changed.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        weights_q, weights_u : array_like (k, ..., nq), (k, ..., nu), optional
            Weights of the assembled coordinates and speeds in each of k sums.

        Returns
        -------
        Gradients
            `q` (k, ..., nq), `u`, `p`, `inputs` and `t` (k, ...); those of dependent entries are zero.

        Examples
        --------
        >>> q, u = four_bar.initial
        >>> four_bar.assemble_gradients(q, u, weights_q={"rocker": 1.0}).q.round(3)
        array([[0.404, 0.   , 0.   ]])
        """
        return self._gradients.of_assembled((q, u, p, inputs, t), weights_q, weights_u)

    @functools.cached_property
    def _gradients(self) -> WeightedGradients:
        return WeightedGradients(self, self._states)

    # -- second derivatives --------------------------------------------------------------------------------------------

    def hessian_products(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, weights: Numbers,
        dq: Numbers = None, du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Numbers = None,
        out: Any = None,
    ) -> HessianProducts:  # fmt: skip
        """Return products of the Hessian of ``sum_i weights_i udot_i`` with directions, exact to rounding.

        These are the changes of the sum's gradient (`gradients`) along the directions. The function is generated on
        request, with ``--functions``. In mechanisms with loops only the independent entries of dq and du are read;
        closure determines the dependent ones, whose results are zero.

        Parameters
        ----------
        q, u : array_like (..., nq), (..., nu)
            Coordinates and speeds, SI units and radians.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        weights : array_like (..., nu)
            Weights of the entries of udot.
        dq, du, dp, dinputs, dt : array_like (k, ..., nq), (k, ..., nu), and so on, optional
            Entries of k directions; those left out are zero. At least one is needed.
        out : tuple of ndarray, optional
            Arrays for the five results.

        Returns
        -------
        HessianProducts
            `q` (k, ..., nq), `u`, `p`, `inputs` and `t` (k, ...).

        Raises
        ------
        ValueError
            If an argument has the wrong shape, or a number is not finite.

        Examples
        --------
        >>> pendulum.hessian_products([0.5], [0.0], weights=[1.0], dq=[1.0]).q.round(3)  # g sin(q)
        array([[4.703]])
        """
        return self._hessians.products("accelerations", (q, u, p, inputs, t, weights), (dq, du, dp, dinputs, dt), out)

    def output_hessian_products(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, weights: Numbers,
        dq: Numbers = None, du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Numbers = None,
        out: Any = None,
    ) -> HessianProducts:  # fmt: skip
        """Return products of the Hessian of ``sum_i weights_i outputs_i`` with directions, exact to rounding.

        These are the changes of the sum's gradient (`output_gradients`) along the directions; see `hessian_products`.
        The function is generated on request, with ``--functions``. Outputs may depend on accelerations and on
        forces of prescribed motion.

        Parameters
        ----------
        q, u : array_like (..., nq), (..., nu)
            Coordinates and speeds, SI units and radians.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        weights : array_like (..., noutputs)
            Weights of the outputs.
        dq, du, dp, dinputs, dt : array_like (k, ..., nq), (k, ..., nu), and so on, optional
            Entries of k directions; those left out are zero. At least one is needed.
        out : tuple of ndarray, optional
            Arrays for the five results.

        Returns
        -------
        HessianProducts
            `q` (k, ..., nq), `u`, `p`, `inputs` and `t` (k, ...).

        Raises
        ------
        ValueError
            If an argument has the wrong shape, or a number is not finite.

        Examples
        --------
        >>> pendulum.output_hessian_products([0.5], [0.0], weights={"x": 1.0}, dq=[1.0]).q.round(3)  # -sin(q)
        array([[-0.479]])
        """
        return self._hessians.products("outputs", (q, u, p, inputs, t, weights), (dq, du, dp, dinputs, dt), out)

    def energy_hessian_products(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, weights: Numbers,
        dq: Numbers = None, du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Numbers = None,
        out: Any = None,
    ) -> HessianProducts:  # fmt: skip
        """Return products of the Hessian of a weighted sum of kinetic and potential energy with directions, exact to rounding.

        These are the changes of the sum's gradient (`energy_gradients`) along the directions; see `hessian_products`.
        The function is generated on request, with ``--functions``.

        Parameters
        ----------
        q, u : array_like (..., nq), (..., nu)
            Coordinates and speeds, SI units and radians.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        weights : array_like (..., 2)
            Weights of kinetic and potential energy.
        dq, du, dp, dinputs, dt : array_like (k, ..., nq), (k, ..., nu), and so on, optional
            Entries of k directions; those left out are zero. At least one is needed.
        out : tuple of ndarray, optional
            Arrays for the five results.

        Returns
        -------
        HessianProducts
            `q` (k, ..., nq), `u`, `p`, `inputs` and `t` (k, ...).

        Raises
        ------
        ValueError
            If an argument has the wrong shape, or a number is not finite.

        Examples
        --------
        >>> pendulum.energy_hessian_products([0.5], [0.0], weights=[1.0, 1.0], dq=[1.0]).q.round(3)  # m g l cos(q)
        array([[8.609]])
        """
        return self._hessians.products("energies", (q, u, p, inputs, t, weights), (dq, du, dp, dinputs, dt), out)

    def coordinate_rate_hessian_products(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, weights: Numbers,
        dq: Numbers = None, du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Numbers = None,
        out: Any = None,
    ) -> HessianProducts:  # fmt: skip
        """Return products of the Hessian of ``sum_i weights_i qdot_i`` with directions, exact to rounding.

        These are the changes of the sum's gradient (`coordinate_rate_gradients`) along the directions; see
        `hessian_products`. They are zero unless the model has loops or quaternions. The function is generated on
        request, with ``--functions``.

        Parameters
        ----------
        q, u : array_like (..., nq), (..., nu)
            Coordinates and speeds, SI units and radians.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        weights : array_like (..., nq)
            Weights of the rates of the coordinates.
        dq, du, dp, dinputs, dt : array_like (k, ..., nq), (k, ..., nu), and so on, optional
            Entries of k directions; those left out are zero. At least one is needed.
        out : tuple of ndarray, optional
            Arrays for the five results.

        Returns
        -------
        HessianProducts
            `q` (k, ..., nq), `u`, `p`, `inputs` and `t` (k, ...).

        Raises
        ------
        ValueError
            If an argument has the wrong shape, or a number is not finite.

        Examples
        --------
        >>> pendulum.coordinate_rate_hessian_products([0.5], [0.0], weights=[1.0], dq=[1.0]).q  # qdot = u
        array([[0.]])
        """
        return self._hessians.products(
            "coordinate_rates", (q, u, p, inputs, t, weights), (dq, du, dp, dinputs, dt), out
        )

    def assemble_hessian_products(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        weights_q: Numbers = None, weights_u: Numbers = None, dq: Numbers = None, du: Numbers = None,
        dp: Numbers = None, dinputs: Numbers = None, dt: Numbers = None,
    ) -> HessianProducts:  # fmt: skip
        """Return products of the Hessian of a weighted sum of the assembled state with directions, exact to rounding.

        These are the changes of the sum's gradient (`assemble_gradients`) along the directions: second derivatives of
        dependent coordinates and speeds. For loops, the function is generated on request, with ``--functions``; models
        with quaternions also need `assemble_gradients`. If loops determine a part of a quaternion, directions must keep
        the loops closed, as those of `assemble_sensitivities` do, and the Hessian is not symmetric.

        Parameters
        ----------
        q, u : array_like (..., nq), (..., nu)
            The guess: independent entries are kept, dependent ones are changed.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        weights_q, weights_u : array_like (..., nq), (..., nu), optional
            Weights of the assembled coordinates and speeds; those left out are zero.
        dq, du, dp, dinputs, dt : array_like (k, ..., nq), (k, ..., nu), and so on, optional
            Entries of k directions; those left out are zero. At least one is needed. Dependent entries are not read.

        Returns
        -------
        HessianProducts
            `q` (k, ..., nq), `u`, `p`, `inputs` and `t` (k, ...); those of dependent entries are zero.

        Raises
        ------
        ValueError
            If an argument has the wrong shape, a number is not finite, or a direction turns a quaternion against the loops.

        Examples
        --------
        >>> q, u = slider_crank.initial
        >>> slider_crank.assemble_hessian_products(q, u, weights_q={"piston": 1.0}, dq={"wheel": 1.0}).q.round(3)
        array([[-0.12,  0.  ,  0.  ]])
        """
        given, seeds = (q, u, p, inputs, t), (dq, du, dp, dinputs, dt)
        return self._hessians.of_assembled(given, weights_q, weights_u, seeds)

    def inverse_dynamics_hessian_products(
        self, q: Numbers, u: Numbers, udot: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        weights: Numbers, dq: Numbers = None, du: Numbers = None, dudot: Numbers = None, dp: Numbers = None,
        dinputs: Numbers = None, dt: Numbers = None, out: Any = None,
    ) -> InverseDynamicsProducts:  # fmt: skip
        """Return products of the Hessian of ``sum_i weights_i force_i`` with directions, exact to rounding.

        The forces are those of `inverse_dynamics`; with loops, those along the n independent speeds. The function is
        generated on request, with ``--functions``.

        Parameters
        ----------
        q, u, udot : array_like (..., nq), (..., nu), (..., nu)
            Coordinates, speeds and their derivatives, SI units and radians.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        weights : array_like (..., nu), with loops (..., n)
            Weights of the entries of the force.
        dq, du, dudot, dp, dinputs, dt : array_like (k, ..., nq), (k, ..., nu), and so on, optional
            Entries of k directions; those left out are zero. At least one is needed.
        out : tuple of ndarray, optional
            Arrays for the six results.

        Returns
        -------
        InverseDynamicsProducts
            `q` (k, ..., nq), `u`, `udot`, `p`, `inputs` and `t` (k, ...).

        Raises
        ------
        ValueError
            If an argument has the wrong shape, or a number is not finite.

        Examples
        --------
        >>> products = pendulum.inverse_dynamics_hessian_products([0.5], [0.0], [0.0], weights=[1.0], dq=[1.0])
        >>> products.q.round(3)  # -m g l sin(q)
        array([[-4.703]])
        """
        given, seeds = (q, u, p, inputs, t, udot, weights), (dq, du, dp, dinputs, dt, dudot)
        return self._hessians.of_inverse_dynamics(given, seeds, out)

    def hessians(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, weights: Numbers,
        wrt: str | Sequence[str] | None = "q, u, p", of: str = "accelerations",
    ) -> Array:  # fmt: skip
        """Return the Hessian of ``sum_i weights_i udot_i``, or of another weighted sum, exact to rounding.

        Each column is one product with a direction, see `hessian_products`. The matrix is symmetric to rounding,
        unless loops determine a part of a quaternion or position, whose entries then depend on each other.

        Parameters
        ----------
        q, u : array_like (..., nq), (..., nu)
            Coordinates and speeds, SI units and radians.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        weights : array_like (..., nu)
            Weights of the entries of udot, or of the results of the function `of`.
        wrt : str or iterable of str, optional
            Variables of rows and columns: names among q, u, p, inputs and t, used in this order. Default: all.
        of : str, optional
            The function whose results are summed: "accelerations", "outputs", "energies" or "coordinate_rates". Generate
            its products, such as `output_hessian_products`.

        Returns
        -------
        ndarray (..., n, n)
            n is the number of entries of these variables.

        Raises
        ------
        ValueError
            If an argument has the wrong shape, a number is not finite, `wrt` names no variable, or `of` no function.

        Examples
        --------
        >>> pendulum.hessians([0.5], [0.0], weights=[1.0], wrt="q, u").round(3)
        array([[4.703, 0.   ],
               [0.   , 0.   ]])
        """
        return self._hessians.matrix(of, (q, u, p, inputs, t, weights), wrt)

    @functools.cached_property
    def _hessians(self) -> Hessians:
        return Hessians(self, self._states)

    # -- second derivatives of equilibria ------------------------------------------------------------------------------

    def equilibrium_hessian_products(
        self, q: Numbers = None, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, weights_q: Numbers,
        dp: Numbers = None, dinputs: Numbers = None,
    ) -> EquilibriumProducts:  # fmt: skip
        """Return products of the Hessian of ``sum_i weights_q_i q_i`` of an equilibrium with directions, exact to rounding.

        The equilibrium depends on parameters and inputs. The gradient of the sum is the weighted sum of the columns of
        `Equilibrium.dq`; the products are the changes of this gradient along the directions. The function needs
        `hessian_products`, generated on request with ``--functions``; for loops also `assemble_hessian_products` and
        `assemble_gradients`.

        Parameters
        ----------
        q : array_like (nq,), optional
            The `q` of an `Equilibrium`. Default: the model's initial coordinates.
        p, inputs, t : array_like (np,), (ninputs,), float, optional
            Parameters, inputs and time (s) of the equilibrium. Default: default parameters, zero inputs, t = 0.
        weights_q : array_like (nq,)
            Weights of the coordinates.
        dp, dinputs : array_like (k, np), (k, ninputs), optional
            Entries of k directions; those left out are zero. At least one is needed.

        Returns
        -------
        EquilibriumProducts
            `p` (k, np) and `inputs` (k, ninputs); NaN with a warning if the equilibrium has a neutral direction.

        Raises
        ------
        ValueError
            If q is not an equilibrium, an argument has the wrong shape, or a number is not finite.

        See Also
        --------
        equilibrium : Finds the equilibrium, and its first derivatives.

        Examples
        --------
        >>> rest = slider_crank.equilibrium(sensitivities="crank_length")
        >>> by = slider_crank.equilibrium_hessian_products(rest.q, weights_q={"piston": 1.0}, dp={"crank_length": 1.0})
        >>> by.p[0, :3].round(3)  # of the piston, by crank_length and crank_length, rod_length, offset
        array([ 0.148,  2.843, -0.341])
        """
        given = (q, p, inputs, t)
        return equilibrium_products(self._statics, self._hessians, self._gradients, given, weights_q, dp, dinputs)

    # -- energies ------------------------------------------------------------------------------------------------------

    def energies(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0
    ) -> tuple[Array, Array]:
        """Return kinetic and potential energy.

        The potential energy of gravity is zero at the ground's origin, that of springs at their free length. Joint
        forces, forces, torques and actuators have no potential energy.

        Parameters
        ----------
        q, u : array_like (..., nq), (..., nu)
            Coordinates and speeds, SI units and radians.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.

        Returns
        -------
        kinetic : ndarray (...)
            Kinetic energy, J.
        potential : ndarray (...)
            Potential energy, J.

        Examples
        --------
        >>> q, u = solver.initial
        >>> kinetic, potential = solver.energies(q, u)
        >>> float(kinetic), round(float(potential), 3)
        (0.0, -8.955)
        """
        (energy,) = self._call("energies", (q, u, p, inputs, t))
        return energy[..., 0], energy[..., 1]

    def energy_sensitivities(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None,
    ) -> tuple[tuple[Array, Array], tuple[Array, Array]]:  # fmt: skip
        """Return kinetic and potential energy and their total derivatives along seeds.

        Parameters
        ----------
        q, u : array_like (..., nq), (..., nu)
            Coordinates and speeds, SI units and radians.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        dq, du, dp, dinputs, dt : array_like (k, ..., nq), (k, ..., nu), ..., optional
            Seeds, at least one: k directions of change of the arguments. Those left out are zero.

        Returns
        -------
        energies : tuple of two ndarray (...)
            Kinetic and potential energy, J.
        derivatives : tuple of two ndarray (k, ...)
            Their derivative along each direction.

        Examples
        --------
        >>> q, u = solver.initial
        >>> energies, (dkinetic, dpotential) = solver.energy_sensitivities(q, u, dp={"mass_1": 1.0})
        >>> dpotential.round(3)
        array([-1.777])
        """
        energy, denergy = self._call("energy_sensitivities", (q, u, p, inputs, t), (dq, du, dp, dinputs, dt))
        return (energy[..., 0], energy[..., 1]), (denergy[..., 0], denergy[..., 1])

    # -- outputs -------------------------------------------------------------------------------------------------------

    def outputs(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        out: Array | None = None,
    ) -> Array:  # fmt: skip
        """Return the model's outputs.

        Parameters
        ----------
        q, u : array_like (..., nq), (..., nu)
            Coordinates and speeds, SI units and radians.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        out : ndarray, optional
            Array for the result. It is returned.

        Returns
        -------
        ndarray (..., noutputs)
            Values in the order of `output_names`, in the unit of each output.

        Examples
        --------
        >>> q, u = solver.initial
        >>> dict(zip(solver.output_names, solver.outputs(q, u).round(3).tolist()))
        {'tip_x': -1.506, 'tip_z': -0.92, 'kinetic': 0.0, 'potential': -8.955, 'upper': 1.2, 'lower': -0.4}
        """
        return self._call("outputs", (q, u, p, inputs, t), None, out)[0]

    def output_sensitivities(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None,
        out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """Return the model's outputs and their total derivatives along seeds.

        Parameters
        ----------
        q, u : array_like (..., nq), (..., nu)
            Coordinates and speeds, SI units and radians.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        dq, du, dp, dinputs, dt : array_like (k, ..., nq), (k, ..., nu), ..., optional
            Seeds, at least one: k directions of change of the arguments. Those left out are zero.
        out : tuple of two ndarray, optional
            Arrays for value and derivative. They are returned.

        Returns
        -------
        outputs : ndarray (..., noutputs)
            Values in the order of `output_names`.
        doutputs : ndarray (k, ..., noutputs)
            Their derivative along each direction.

        Examples
        --------
        >>> q, u = solver.initial
        >>> outputs, doutputs = solver.output_sensitivities(q, u, dp={"length_2": 1.0})
        >>> doutputs[0, :2].round(3)
        array([-0.717, -0.697])
        """
        return self._call("output_sensitivities", (q, u, p, inputs, t), (dq, du, dp, dinputs, dt), out)

    # -- forces --------------------------------------------------------------------------------------------------------

    def mass_matrix(
        self, q: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, out: Array | None = None
    ) -> Array:
        """Return the mass matrix M of Eq. 4.

        With closed loops it is the matrix of the n independent speeds.

        Parameters
        ----------
        q : array_like (..., nq)
            Coordinates, SI units and radians.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Inputs and t matter where motion is prescribed.
        out : ndarray, optional
            Array for the result. It is returned.

        Returns
        -------
        ndarray (..., nu, nu)
            M; (..., n, n) with closed loops. kg m^2, kg m or kg.

        Examples
        --------
        >>> q, u = solver.initial
        >>> solver.mass_matrix(q).round(4)
        array([[2.4505, 0.5819],
               [0.5819, 0.2135]])
        """
        return self._call("mass_matrix", (q, None, p, inputs, t), None, out)[0]

    def mass_matrix_sensitivities(
        self, q: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None, out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """Return the mass matrix and its total derivatives along seeds.

        Parameters
        ----------
        q : array_like (..., nq)
            Coordinates, SI units and radians.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        dq, dp, dinputs, dt : array_like (k, ..., nq), (k, ..., np), ..., optional
            Seeds, at least one: k directions of change of the arguments. Those left out are zero.
        out : tuple of two ndarray, optional
            Arrays for value and derivative. They are returned.

        Returns
        -------
        M : ndarray (..., nu, nu)
            The mass matrix; with closed loops (..., n, n), for the n independent speeds.
        dM : ndarray (k, ..., nu, nu)
            Its derivative along each direction.

        Examples
        --------
        >>> q, u = solver.initial
        >>> M, dM = solver.mass_matrix_sensitivities(q, dp={"mass_2": 1.0})
        >>> dM.round(4)
        array([[[1.9503, 0.5819],
                [0.5819, 0.2135]]])
        """
        return self._call("mass_matrix_sensitivities", (q, None, p, inputs, t), (dq, None, dp, dinputs, dt), out)

    def inverse_dynamics(
        self, q: Numbers, u: Numbers, udot: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        out: Array | None = None,
    ) -> Array:  # fmt: skip
        """Return the joint forces that given accelerations need in addition to the model's own forces.

        With closed loops they act at the joints of the n independent speeds, and only the independent entries of udot
        are read.

        Parameters
        ----------
        q, u, udot : array_like (..., nq), (..., nu), (..., nu)
            Coordinates, speeds and their derivatives, SI units and radians.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        out : ndarray, optional
            Array for the result. It is returned.

        Returns
        -------
        ndarray (..., nu)
            Generalised forces M udot - K, N m or N; with closed loops (..., n).

        Examples
        --------
        >>> q, u = solver.initial
        >>> solver.inverse_dynamics(q, u, [0.0, 0.0]).round(3)
        array([18.816,  2.015])
        """
        return self._call("inverse_dynamics", (q, u, p, inputs, t, udot), None, out)[0]

    def inverse_dynamics_sensitivities(
        self, q: Numbers, u: Numbers, udot: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        dq: Numbers = None, du: Numbers = None, dudot: Numbers = None, dp: Numbers = None, dinputs: Numbers = None,
        dt: Times | None = None, out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """Return the forces of `inverse_dynamics` and their total derivatives along seeds.

        Parameters
        ----------
        q, u, udot : array_like (..., nq), (..., nu), (..., nu)
            Coordinates, speeds and their derivatives, SI units and radians.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        dq, du, dudot, dp, dinputs, dt : array_like (k, ..., nq), (k, ..., nu), ..., optional
            Seeds, at least one: k directions of change of the arguments. Those left out are zero.
        out : tuple of two ndarray, optional
            Arrays for value and derivative. They are returned.

        Returns
        -------
        force : ndarray (..., nu)
            Generalised forces, N m or N; with closed loops (..., n), for the n independent speeds.
        dforce : ndarray (k, ..., nu)
            Their derivative along each direction.

        Examples
        --------
        >>> q, u = solver.initial
        >>> force, dforce = solver.inverse_dynamics_sensitivities(q, u, [0.0, 0.0], dudot=np.eye(2))
        >>> dforce.round(4)
        array([[2.4505, 0.5819],
               [0.5819, 0.2135]])
        """
        given, along = (q, u, p, inputs, t, udot), (dq, du, dp, dinputs, dt, dudot)
        return self._call("inverse_dynamics_sensitivities", given, along, out)

    def bias_force(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        out: Array | None = None,
    ) -> Array:  # fmt: skip
        """Return the joint forces that keep udot at zero: -K of Eq. 4.

        The equations of motion are ``M udot + bias_force = 0``.

        Parameters
        ----------
        q, u : array_like (..., nq), (..., nu)
            Coordinates and speeds, SI units and radians.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        out : ndarray, optional
            Array for the result. It is returned.

        Returns
        -------
        ndarray (..., nu)
            Generalised forces, N m or N; with closed loops (..., n), for the n independent speeds.

        Examples
        --------
        >>> q, u = solver.initial
        >>> M, bias = solver.mass_matrix(q), solver.bias_force(q, u)
        >>> np.allclose(np.linalg.solve(M, -bias), solver.accelerations(q, u))
        True
        """
        return self._call("inverse_dynamics", (q, u, p, inputs, t, np.zeros(self.nu)), None, out)[0]

    def bias_force_sensitivities(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None,
        out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """Return the forces of `bias_force` and their total derivatives along seeds.

        Parameters
        ----------
        q, u : array_like (..., nq), (..., nu)
            Coordinates and speeds, SI units and radians.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        dq, du, dp, dinputs, dt : array_like (k, ..., nq), (k, ..., nu), ..., optional
            Seeds, at least one: k directions of change of the arguments. Those left out are zero.
        out : tuple of two ndarray, optional
            Arrays for value and derivative. They are returned.

        Returns
        -------
        force : ndarray (..., nu)
            Generalised forces, N m or N; with closed loops (..., n), for the n independent speeds.
        dforce : ndarray (k, ..., nu)
            Their derivative along each direction.

        Examples
        --------
        >>> q, u = solver.initial
        >>> force, dforce = solver.bias_force_sensitivities(q, u, dp={"stiffness": 1.0})
        >>> dforce.round(3)
        array([[ 0. , -0.4]])
        """
        given, along = (q, u, p, inputs, t, np.zeros(self.nu)), (dq, du, dp, dinputs, dt, None)
        return self._call("inverse_dynamics_sensitivities", given, along, out)

    @functools.cached_property
    def _composed(self) -> Mapping[str, Composed]:
        if not self.closure_names:
            return {}
        from .state.loop_forces import LoopForces

        return LoopForces(self).functions

    # -- inverse of the mass matrix ------------------------------------------------------------------------------------

    def inverse_mass_matrix(
        self, q: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, out: Array | None = None
    ) -> Array:
        """Return the inverse of the mass matrix in O(n^2), for models without loops.

        It comes from the factors of the forward dynamics; M is not formed.

        Parameters
        ----------
        q : array_like (..., nq)
            Coordinates, SI units and radians.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        out : ndarray, optional
            Array for the result. It is returned.

        Returns
        -------
        ndarray (..., nu, nu)
            The inverse of M. Its columns are solutions of `solve_mass`.

        Examples
        --------
        >>> q, u = solver.initial
        >>> np.allclose(solver.inverse_mass_matrix(q) @ solver.mass_matrix(q), np.eye(2))
        True
        """
        return self._call("inverse_mass_matrix", (q, None, p, inputs, t), None, out)[0]

    def solve_mass(
        self, q: Numbers, b: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        out: Array | None = None,
    ) -> Array:  # fmt: skip
        """Return the solution x of ``M x = b`` in O(n), for models without loops.

        Parameters
        ----------
        q, b : array_like (..., nq), (..., nu)
            Coordinates, SI units and radians; generalised forces, N m or N.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        out : ndarray, optional
            Array for the result. It is returned.

        Returns
        -------
        ndarray (..., nu)
            Accelerations x, rad/s^2 or m/s^2.

        Examples
        --------
        >>> q, u = solver.initial
        >>> solver.solve_mass(q, [1.0, 0.0]).round(3)
        array([ 1.157, -3.154])
        """
        return self._call("solve_mass", (q, None, p, inputs, t, b), None, out)[0]

    def solve_mass_sensitivities(
        self, q: Numbers, b: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        db: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None,
        out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """Return the solution of ``M x = b`` and its total derivatives along seeds.

        Parameters
        ----------
        q, b : array_like (..., nq), (..., nu)
            Coordinates, SI units and radians; generalised forces, N m or N.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        dq, db, dp, dinputs, dt : array_like (k, ..., nq), (k, ..., nu), ..., optional
            Seeds, at least one: k directions of change of the arguments. Those left out are zero.
        out : tuple of two ndarray, optional
            Arrays for value and derivative. They are returned.

        Returns
        -------
        x : ndarray (..., nu)
            Accelerations, rad/s^2 or m/s^2.
        dx : ndarray (k, ..., nu)
            Their derivative along each direction.

        Examples
        --------
        >>> q, u = solver.initial
        >>> x, dx = solver.solve_mass_sensitivities(q, [1.0, 0.0], dp={"mass_1": 1.0})
        >>> dx.round(3)
        array([[-0.446,  1.217]])
        """
        along = (dq, None, dp, dinputs, dt, db)
        return self._call("solve_mass_sensitivities", (q, None, p, inputs, t, b), along, out)

    # -- driving forces ------------------------------------------------------------------------------------------------

    def driving_forces(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, out: Array | None = None
    ) -> Array:  # fmt: skip
        """Return the generalised forces that prescribed motion needs, in addition to the model's own forces.

        The power of each force is the force times the rate of its prescribed coordinate.

        Parameters
        ----------
        q, u : array_like (..., nq), (..., nu)
            Coordinates and speeds, SI units and radians.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        out : ndarray, optional
            Array for the result. It is returned.

        Returns
        -------
        ndarray (..., nprescribed)
            One force for each of `prescribed_names`, N m or N.

        Examples
        --------
        >>> q, u = shaken.initial
        >>> shaken.driving_forces(q, u, t=0.005).round(2)
        array([-1580.16])
        """
        return self._call("driving_forces", (q, u, p, inputs, t), None, out)[0]

    def driving_force_sensitivities(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None,
        out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """Return the forces of `driving_forces` and their total derivatives along seeds.

        Parameters
        ----------
        q, u : array_like (..., nq), (..., nu)
            Coordinates and speeds, SI units and radians.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        dq, du, dp, dinputs, dt : array_like (k, ..., nq), (k, ..., nu), ..., optional
            Seeds, at least one: k directions of change of the arguments. Those left out are zero.
        out : tuple of two ndarray, optional
            Arrays for value and derivative. They are returned.

        Returns
        -------
        force : ndarray (..., nprescribed)
            One force for each of `prescribed_names`, N m or N.
        dforce : ndarray (k, ..., nprescribed)
            Their derivative along each direction.

        Examples
        --------
        >>> q, u = shaken.initial
        >>> force, dforce = shaken.driving_force_sensitivities(q, u, t=0.005, dp={"amplitude": 1.0})
        >>> dforce.round(1)
        array([[-40067.2]])
        """
        return self._call("driving_force_sensitivities", (q, u, p, inputs, t), (dq, du, dp, dinputs, dt), out)

    # -- reactions -----------------------------------------------------------------------------------------------------

    def reactions(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0
    ) -> tuple[Array, Array]:
        """Return the moments and forces that joints and loops transmit, in the ground frame.

        The package must have been generated with reactions.

        Parameters
        ----------
        q, u : array_like (..., nq), (..., nu)
            Coordinates and speeds, SI units and radians.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.

        Returns
        -------
        joints : ndarray (..., nbodies, 6)
            Moment (N m) about the body's origin, then force (N), exerted on each body by its joint, the joint's own
            force included. NaN for a body on a fixed joint, which is merged with the body that carries it.
        loops : ndarray (..., nloops, 6)
            The same for each loop joint, exerted on its ``to`` body about the origin of the face there. Where redundant
            conditions leave these wrenches undetermined, the values minimise a sum of squares in each closure group: of
            the moments, and of the forces times the characteristic length.

        Examples
        --------
        >>> q, u = solver.initial
        >>> joints, loops = solver.reactions(q, u)
        >>> joints[0].round(3)
        array([0.   , 0.   , 0.   , 4.991, 0.   , 4.308])
        """
        return reactions_of(self._joint_links, self._call("reactions", (q, u, p, inputs, t)))

    def reaction_sensitivities(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None,
    ) -> tuple[Array, Array, Array, Array]:  # fmt: skip
        """Return the values of `reactions` and their total derivatives along seeds.

        Seeds of dependent coordinates and speeds follow from closure. Where conditions are redundant, the result is the
        derivative of the values that `reactions` returns.

        Parameters
        ----------
        q, u : array_like (..., nq), (..., nu)
            Coordinates and speeds, SI units and radians.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        dq, du, dp, dinputs, dt : array_like (k, ..., nq), (k, ..., nu), ..., optional
            Seeds, at least one: k directions of change of the arguments. Those left out are zero.

        Returns
        -------
        joints, loops : ndarray (..., nbodies, 6), (..., nloops, 6)
            The values of `reactions`.
        djoints, dloops : ndarray (k, ..., nbodies, 6), (k, ..., nloops, 6)
            Derivatives of their components in the ground frame along each direction. NaN where `joints` is NaN.

        Examples
        --------
        >>> q, u = solver.initial
        >>> joints, loops, djoints, dloops = solver.reaction_sensitivities(q, u, dp={"mass_2": 1.0})
        >>> djoints[0, 0].round(3)
        array([0.   , 0.   , 0.   , 1.611, 0.   , 1.038])
        """
        found = self._call("reaction_sensitivities", (q, u, p, inputs, t), (dq, du, dp, dinputs, dt))
        return reaction_sensitivities_of(self._joint_links, found)

    @functools.cached_property
    def _joint_links(self) -> JointLinks:
        return joint_links(self._manifest)

    # -- frames --------------------------------------------------------------------------------------------------------

    def frames(
        self, q: Numbers, u: Numbers = None, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        bodies: Bodies = None, accelerations: bool = False,
    ) -> FrameMotion:  # fmt: skip
        """Return pose and velocity of bodies, and accelerations on request.

        The package must have been generated with frames. Dependent speeds follow from closure; coordinates are used as
        they are passed.

        Parameters
        ----------
        q : array_like (..., nq)
            Coordinates, SI units and radians.
        u : array_like (..., nu), optional
            Speeds. Default: zeros.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        bodies : str or sequence of str, optional
            Names of n bodies. A single name gives arrays without the axis n. Default: all bodies, in the order of the
            model.
        accelerations : bool, optional
            Also compute accelerations, which requires the forward dynamics.

        Returns
        -------
        FrameMotion
            Rotation, position and velocities of the bodies relative to the ground, in the ground frame.

        Examples
        --------
        >>> q, u = solver.initial
        >>> solver.frames(q, bodies="lower").position.round(3)
        array([-0.932,  0.   , -0.362])
        """
        return self._frames.frames((q, u, p, inputs, t), bodies, accelerations)

    def frame_sensitivities(
        self, q: Numbers, u: Numbers = None, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        bodies: Bodies = None, accelerations: bool = False, dq: Numbers = None, du: Numbers = None, dp: Numbers = None,
        dinputs: Numbers = None, dt: Times | None = None,
    ) -> tuple[FrameMotion, FrameMotion]:  # fmt: skip
        """Return the motions of `frames` and their total derivatives along seeds.

        Parameters
        ----------
        q : array_like (..., nq)
            Coordinates, SI units and radians.
        u : array_like (..., nu), optional
            Speeds. Default: zeros.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        bodies : str or sequence of str, optional
            Names of n bodies. A single name gives arrays without the axis n. Default: all bodies, in the order of the
            model.
        accelerations : bool, optional
            Also compute accelerations, which requires the forward dynamics.
        dq, du, dp, dinputs, dt : array_like (k, ..., nq), (k, ..., nu), ..., optional
            Seeds, at least one: k directions of change of the arguments. Those left out are zero.

        Returns
        -------
        frames : FrameMotion
            The motions of the bodies.
        dframes : FrameMotion
            Their derivatives, directions first: ``rotation (k, ..., n, 3, 3)``, ``position (k, ..., n, 3)`` and so on.

        Examples
        --------
        >>> q, u = solver.initial
        >>> frames, dframes = solver.frame_sensitivities(q, bodies="lower", dp={"length_1": 1.0})
        >>> dframes.position.round(3)
        array([[-0.932,  0.   , -0.362]])
        """
        return self._frames.frame_sensitivities((q, u, p, inputs, t), (dq, du, dp, dinputs, dt), bodies, accelerations)

    def frame_jacobians(
        self, q: Numbers, u: Numbers = None, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        bodies: Bodies = None,
    ) -> Array:  # fmt: skip
        """Return the geometric Jacobians of bodies.

        Their product with u is the velocity of the bodies, without the part due to prescribed motion. They do not
        depend on u.

        Parameters
        ----------
        q : array_like (..., nq)
            Coordinates, SI units and radians.
        u : array_like (..., nu), optional
            Speeds. Default: zeros.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        bodies : str or sequence of str, optional
            Names of n bodies. A single name gives arrays without the axis n. Default: all bodies, in the order of the
            model.

        Returns
        -------
        ndarray (..., n, 6, nu)
            Rows: angular velocity, then velocity of the body's origin, along the ground's axes. Columns of dependent
            speeds are zero; the columns of the independent ones contain the effect of the dependent ones.

        Examples
        --------
        >>> q, u = solver.initial
        >>> solver.frame_jacobians(q, bodies="lower").round(3)
        array([[ 0.   ,  0.   ],
               [ 1.   ,  1.   ],
               [ 0.   ,  0.   ],
               [-0.362,  0.   ],
               [ 0.   ,  0.   ],
               [ 0.932,  0.   ]])
        """
        return self._frames.frame_jacobians(q, p, inputs, t, bodies)

    def points(
        self, q: Numbers, u: Numbers = None, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        points: Points = None, accelerations: bool = False,
    ) -> PointMotion:  # fmt: skip
        """Return position and velocity of points fixed in bodies, and accelerations on request.

        The package must have been generated with frames.

        Parameters
        ----------
        q : array_like (..., nq)
            Coordinates, SI units and radians.
        u : array_like (..., nu), optional
            Speeds. Default: zeros.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        points : str, pair, or list of both, optional
            The n points: names of points of the model, names of bodies (their origins), or pairs of a body (or ``"ground"``)
            and a place (3,) in its frame, m. A single one gives arrays without the axis n. Default: all points of the model.
        accelerations : bool, optional
            Also compute accelerations, which requires the forward dynamics.

        Returns
        -------
        PointMotion
            Position and velocity of the points relative to the ground, in the ground frame.

        Examples
        --------
        >>> q, u = solver.initial
        >>> solver.points(q, points="tip").position.round(3)
        array([-1.506,  0.   , -0.92 ])
        >>> solver.points(q, points=[("upper", [0, 0, -0.5]), "lower"]).position.shape
        (2, 3)
        """
        return self._frames.points((q, u, p, inputs, t), points, accelerations)

    def point_sensitivities(
        self, q: Numbers, u: Numbers = None, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        points: Points = None, accelerations: bool = False, dq: Numbers = None, du: Numbers = None, dp: Numbers = None,
        dinputs: Numbers = None, dt: Times | None = None,
    ) -> tuple[PointMotion, PointMotion]:  # fmt: skip
        """Return the motions of `points` and their total derivatives along seeds.

        Where parameters move a point of the model in its body, the derivative along dp includes this movement. A place that
        is given as numbers is constant.

        Parameters
        ----------
        q : array_like (..., nq)
            Coordinates, SI units and radians.
        u : array_like (..., nu), optional
            Speeds. Default: zeros.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        points : str, pair, or list of both, optional
            The n points: names of points of the model, names of bodies (their origins), or pairs of a body (or ``"ground"``)
            and a place (3,) in its frame, m. A single one gives arrays without the axis n. Default: all points of the model.
        accelerations : bool, optional
            Also compute accelerations, which requires the forward dynamics.
        dq, du, dp, dinputs, dt : array_like (k, ..., nq), (k, ..., nu), ..., optional
            Seeds, at least one: k directions of change of the arguments. Those left out are zero.

        Returns
        -------
        points : PointMotion
            The motions of the points.
        dpoints : PointMotion
            Their derivatives, directions first: ``position (k, ..., n, 3)`` and so on.

        Examples
        --------
        >>> q, u = solver.initial
        >>> points, dpoints = solver.point_sensitivities(q, points="tip", dp={"length_2": 1.0})
        >>> dpoints.position.round(3)
        array([[-0.717,  0.   , -0.697]])
        """
        return self._frames.point_sensitivities((q, u, p, inputs, t), (dq, du, dp, dinputs, dt), points, accelerations)

    def point_jacobians(
        self, q: Numbers, u: Numbers = None, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        points: Points = None,
    ) -> Array:  # fmt: skip
        """Return the geometric Jacobians of points fixed in bodies.

        Parameters
        ----------
        q : array_like (..., nq)
            Coordinates, SI units and radians.
        u : array_like (..., nu), optional
            Speeds. Default: zeros.
        p, inputs, t : array_like (..., np), (..., ninputs), (...), optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        points : str, pair, or list of both, optional
            The n points: names of points of the model, names of bodies (their origins), or pairs of a body (or ``"ground"``)
            and a place (3,) in its frame, m. A single one gives arrays without the axis n. Default: all points of the model.

        Returns
        -------
        ndarray (..., n, 6, nu)
            Rows: angular velocity of the body, then velocity of the point, along the ground's axes. See
            `frame_jacobians`.

        Examples
        --------
        >>> q, u = solver.initial
        >>> solver.point_jacobians(q, points="tip")[3:].round(3)
        array([[-0.92 , -0.557],
               [ 0.   ,  0.   ],
               [ 1.506,  0.574]])
        """
        return self._frames.point_jacobians(q, p, inputs, t, points)

    @functools.cached_property
    def _frames(self) -> Frames:
        return Frames(self)

    # -- views ---------------------------------------------------------------------------------------------------------

    def picture(
        self, q: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        path: str | os.PathLike[str] | None = None, view: str = "auto", folder: str | os.PathLike[str] = ".",
    ) -> Any:  # fmt: skip
        """Draw the mechanism in one state, by matplotlib.

        The package must have been generated with frames. Bodies are shown by their visuals or shapes, or as lines between
        their joints and points.

        Parameters
        ----------
        q : array_like (nq,)
            Coordinates, SI units and radians.
        p, inputs, t : array_like (np,), (ninputs,), float, optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0. Sizes and places follow
            the parameters.
        path : path, optional
            File to write: ``.svg``, ``.png`` or ``.pdf``. The same state gives the same bytes.
        view : {"auto", "x", "y", "z", "corner"}, optional
            Look along an axis of the ground, or from a corner. "auto" looks along the normal if all bodies move in one plane
            of the ground.
        folder : path, optional
            Folder of the model, from which the names of mesh files start.

        Returns
        -------
        matplotlib.figure.Figure
            The figure.

        Raises
        ------
        ImportError
            If matplotlib is not installed (extra ``plot``).

        Warns
        -----
        RuntimeWarning
            If a mesh cannot be read; a small cube is shown instead.

        Examples
        --------
        >>> q, u = solver.initial
        >>> figure = solver.picture(q, path="pose.png")
        """
        return self._views.picture(q, p, inputs, t, path, view, folder)

    def view(
        self, q: Numbers = None, u: Numbers = None, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        folder: str | os.PathLike[str] = ".", port: int = 0, arrows: str | Sequence[str] = (),
    ) -> Viewer:  # fmt: skip
        """Show the mechanism in a browser, with sliders for independent coordinates and design parameters.

        The package must have been generated with frames. Loops stay closed; where they cannot be closed, the view says so
        and does not change. A notebook displays the result as the view.

        Parameters
        ----------
        q, u : array_like (nq,), (nu,), optional
            The state, SI units and radians. Default: the initial state of the model.
        p, inputs, t : array_like (np,), (ninputs,), float, optional
            Parameters, inputs and time (s). Default: default parameters, zero inputs, t = 0.
        folder : path, optional
            Folder of the model, from which the names of mesh files start.
        port : int, optional
            Port of this machine. Default: any that is free.
        arrows : str or sequence of str, optional
            Arrows that are shown at the beginning: "reactions" (if the package has them), "forces" and "torques" of force
            elements.

        Returns
        -------
        Viewer
            The view: `url` is its address, `html` writes it to a page, `close` ends it.

        Raises
        ------
        ImportError
            If viser is not installed (extra ``view``).
        ValueError
            If there are no such arrows.

        Examples
        --------
        >>> view = solver.view()  # doctest: +SKIP
        >>> view.url  # doctest: +SKIP
        'http://127.0.0.1:8080'
        """
        start_q, start_u = self.initial
        return self._views.view(
            start_q if q is None else q, start_u if u is None else u, p, inputs, t, folder, port, arrows
        )

    @functools.cached_property
    def _views(self) -> Views:
        return Views(self)

    # -- motions -------------------------------------------------------------------------------------------------------

    def simulate(
        self, t: Any, q: Numbers = None, u: Numbers = None, p: Numbers = None, inputs: Any = None, *,
        sensitivities: Sequence[str] | str = (), dq0: Numbers = None, du0: Numbers = None, rtol: float = RTOL,
        atol: Any = ATOL, atol_sensitivities: Any = None, method: str = METHOD, step: float | None = None,
        largest_step: float | None = None, most_steps: int = MOST_STEPS, events: Any = (), controller: Any = None,
        period: float | None = None, progress: Progress | None = None, on_failure: str = "raise",
    ) -> Trajectory:  # fmt: skip
        """Integrate the motion and its sensitivities over time (Eqs. 2, 3), in compiled code.

        Parameters
        ----------
        t : float or array_like (nt,)
            Increasing times of the results, s; the motion begins at the first. A number T means from 0 to T, with
            results at the integrator's steps.
        q, u : array_like (nq,), (nu,), optional
            The initial state. Dependent speeds follow from closure; open loops are closed, with a warning. Default:
            the model's initial state, whose dependence on parameters is part of the derivatives.
        p : array_like (np,), optional
            Parameters. Default: the default parameters.
        inputs : array_like (nsignals,), tuple, callable, spline or mapping, optional
            Constants; ``(times, values)`` or ``(times, values, kind)`` with values (ntimes, nsignals); a function of
            time; or SciPy's `BSpline` or `PPoly`. A mapping gives any of these for each signal by name. See Notes.
        sensitivities : str or sequence of str, optional
            Variables of differentiation: parameters, ``q0.NAME`` and ``u0.NAME`` for initial values of independent
            coordinates and speeds, ``inputs.NAME`` for a constant added to an input, ``inputs.NAME[i]`` for its i-th
            value. The name of a vector parameter, or of a joint of several degrees of freedom, stands for its entries.
        dq0, du0 : array_like (k, nq), (k, nu), optional
            Derivatives of the initial state, instead of those that follow from `sensitivities`. Independent entries are
            read.
        rtol : float, optional
            Relative tolerance of a step.
        atol : float or array_like (nq + nu,), optional
            Absolute tolerance of a step, for each independent coordinate and speed.
        atol_sensitivities : float or array_like (k,), optional
            Absolute tolerance of the derivatives. Default: steps are chosen for the state alone. The derivatives are
            those of the computed motion to rounding in either case.
        method : {"dop853", "radau", "rk4"}, optional
            Dormand and Prince's method of order 8; Radau IIA of order 5, for stiff models; the classical Runge-Kutta
            method with constant `step`.
        step, largest_step : float, optional
            First step of an adaptive method or constant step of "rk4", s; upper bound of all steps, s.
        most_steps : int, optional
            Maximum number of steps.
        events : sequence of Event or str, optional
            Outputs that cross a level; a name alone means the level zero. The motion ends at the first event with `stop`.
        controller : callable or pair of callable, optional
            A function of a `Sample`, called at the start and then every `period`; alone, or with its Jacobian. It returns
            the inputs until the next sample, as an array or by name: all signals that `inputs` does not contain. See
            Notes.
        period : float, optional
            Time between two samples of the controller, s.
        progress : callable, optional
            Called as ``progress(time, end)`` about ten times a second. A KeyboardInterrupt in it ends the motion there.
        on_failure : {"raise", "return"}, optional
            Raise `SimulationError` if a motion cannot continue, or return the trajectory up to there with a warning.

        Returns
        -------
        Trajectory
            Times, states, outputs, their derivatives, and events.

        Raises
        ------
        SimulationError
            If the motion cannot continue. The error gives time and cause; its `trajectory` holds the motion up to there.
        AssemblyError
            If the initial state cannot be closed.
        NoCompilerError
            If there is no C compiler.

        Notes
        -----
        The kind of inputs is "linear" (the default), "hold" (each value holds until the next time), "cubic" or
        "quintic" (a spline through the values), or "spline" (ntimes + 2 control points of a cubic B-spline with knots
        at the times). A function of time is replaced by a spline of degree 9. Before their first and after their last
        time, signals are constant. A signal that prescribed motion reads needs a continuous velocity; its rate and
        acceleration are those of the spline.

        The Jacobian of a controller is a function of the same `Sample`. It returns the derivatives of the controller's
        inputs with respect to "q", "u", "outputs", "p" and the previous "inputs", as a mapping of matrices; zeros may be left
        out. A controller with a memory of its own returns the derivatives of its n inputs along the k directions instead,
        (k, n), computed from `Sample.dq` and the other derivatives. Without a Jacobian, derivatives keep the controller's
        values fixed, with a warning. An exception in the controller ends the motion and is raised again.

        Examples
        --------
        >>> run = solver.simulate(2.0, sensitivities=("length_1", "q0.upper"))
        >>> run.q[-1].round(4)
        array([ 0.7396, -0.3181])
        >>> run.dq[:, -1].shape
        (2, 2)
        >>> run = solver.simulate(np.linspace(0.0, 1.0, 101), {"upper": 0.5}, p={"damping": 0.2})
        >>> run.outputs.shape
        (101, 6)
        """
        # long: the docstring describes every argument
        settings = Settings(method, rtol, atol, step, largest_step, most_steps, atol_sensitivities)
        return self._motions.simulate(
            t, Start(q, u, p, inputs, sensitivities, dq0, du0, take_controller(controller, period)), settings, events,
            progress, on_failure,
        )  # fmt: skip

    def judge(
        self, t: Any, functionals: Functional | Sequence[Functional], q: Numbers = None, u: Numbers = None, p: Numbers = None,
        inputs: Any = None, *, wrt: Sequence[str] | str = (), method: str = "auto", dq0: Numbers = None, du0: Numbers = None,
        rtol: float = RTOL, atol: Any = ATOL, integrator: str = METHOD, step: float | None = None,
        largest_step: float | None = None, most_steps: int = MOST_STEPS, memory: int = MEMORY,
        hessian: Numbers | bool = None,
    ) -> Judged:  # fmt: skip
        """Return values of functionals of a motion and their gradients, exact for the steps taken.

        Parameters
        ----------
        t : float or tuple of two float
            End of the motion, s, or its start and end.
        functionals : functional or sequence of functionals
            `Final`, `At`, `Integral`, `AtEvent`, `LeastSquares`.
        q, u, p : array_like (nq,), (nu,), (np,), optional
            Initial state and parameters, as in `simulate`.
        inputs : array_like, tuple, callable, spline or mapping, optional
            Inputs over time, as in `simulate`.
        wrt : str or sequence of str, optional
            Variables of differentiation, like `sensitivities` of `simulate`.
        method : {"auto", "forward", "adjoint"}, optional
            Sensitivities along with the motion, or the discrete adjoint, whose cost does not grow with the number of
            parameters. "auto" uses the cheaper one. Both gradients agree to rounding.
        dq0, du0 : array_like (k, nq), (k, nu), optional
            Derivatives of the initial state, as in `simulate`.
        rtol, atol : float, optional
            Tolerances of a step, as in `simulate`.
        integrator : {"dop853", "radau", "rk4"}, optional
            The method of `simulate`.
        step, largest_step : float, optional
            First or constant step, and upper bound of all steps, s.
        most_steps : int, optional
            Maximum number of steps.
        memory : int, optional
            Bytes in which the adjoint keeps steps. Steps that do not fit are computed twice.
        hessian : bool or array_like (r, k), optional
            Directions of Hessian products, as factors of the k variables of `wrt`; True for the whole Hessian. Products
            are exact for the steps taken; step sizes, dq0 and du0 count as constants. They need a package with
            ``hessian_products``; with quaternions also ``coordinate_rate_hessian_products``, and for integrals of motions
            in which a force or an output changes its branch also ``output_hessian_products``. `method` is then the adjoint.

        Returns
        -------
        Judged
            `values` (m,), `gradients` (m, k), `hessian_products` (m, r, k) and the method that was used.

        Raises
        ------
        SimulationError
            If the motion ends before its time, or an event that a functional needs does not occur.

        Examples
        --------
        >>> from ordernm.runtime import Final, Integral
        >>> found = solver.judge(1.0, [Final("tip_x"), Integral("kinetic")], wrt=("length_1", "mass_2"))
        >>> found.values.round(4)
        array([1.4231, 6.5964])
        >>> found.gradients.shape
        (2, 2)
        """
        # long: the docstring describes every argument
        settings = Settings(integrator, rtol, atol, step, largest_step, most_steps, keyword="integrator")
        return self._motions.judge(
            t, functionals, Start(q, u, p, inputs, wrt, dq0, du0), method, settings, memory, hessian
        )

    @functools.cached_property
    def _motions(self) -> FunctionalGradients:
        return FunctionalGradients(self, self._states)

    def _prepare(self, member: str) -> None:
        if member in ("simulate", "judge"):
            self._motions.prepare(member)
        else:
            super()._prepare(member)

    # -- precision -----------------------------------------------------------------------------------------------------

    def in_precision(self, digits: int = 40, model: Any = None) -> Any:
        """Return this solver in extended precision, to check rounding errors.

        It evaluates the statements of the NumPy module with more digits. Its methods accept floats (which are exact),
        mpmath numbers, and text such as ``"0.1"``. They return arrays of mpmath numbers, which keep their digits for any
        value of ``mpmath.mp.dps``; ``.astype(float)`` rounds an array to doubles. `assemble` closes
        loops to these digits.

        Parameters
        ----------
        digits : int, optional
            Decimal digits of results, at least 16; computations use ten more. Cancellation costs digits, so compare with a
            result of more digits.
        model : Model or path, optional
            The model that the package was generated from. The constants that `generate` computed from it are then
            computed again in these digits; without it they are the doubles in the package. Needs a solver that
            `ordernm.load` has opened.

        Returns
        -------
        Solver
            It has ``digits``, and ``mp`` with mpmath's functions in these digits. `simulate`, `judge`, `equilibrium`,
            `linearize` and `diagnose` are absent.

        Raises
        ------
        ImportError
            If mpmath is not installed.
        ValueError
            If `digits` is out of range, or the package was generated from another model.

        Notes
        -----
        For a model that starts in equilibrium, `initial` is the equilibrium found in double precision.

        Examples
        --------
        >>> exact = solver.in_precision(40)
        >>> q, u = solver.initial
        >>> error = (solver.accelerations(q, u) - exact.accelerations(q, u)).astype(float)
        >>> bool(np.abs(error).max() < 1e-12)
        True
        """
        return extended(self, digits, None if model is None else self._extended_modules(model, digits))

    def _extended_modules(self, model: Any, digits: int) -> PartitionModules:
        """The NumPy modules of the partitions, with constants of the model in more digits; a solver opened by `ordernm.load`
        generates them."""
        raise ValueError("model: a package by itself generates nothing; open it with ordernm.load to give its model")
