"""`Solver`: every function of a generated solver, with what it takes and returns.

Most call one function of the generated code, by `Package._call`. What takes more than that is in the rooms beside this file,
and a method here passes its arguments on. A package carries the sections of this class that its functions need: comments
``-- name --`` head them, and `codegen.runtime.sections` says when they are needed.
"""
# long: a signature and a docstring for each of fifty methods

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .arrays import Array, Numbers, Times
from .assembly.partitions import conditions, partition_names, use_partition
from .assembly.states import States
from .calls.package import Composed, Package
from .motion.functional_gradients import MEMORY, FunctionalGradients
from .motion.functionals import Functional, Judged
from .motion.run import Progress
from .motion.simulation import MOST_STEPS
from .state.derivatives import Gradients, Jacobians
from .state.frame_motion import FrameMotion, PointMotion
from .state.frames import Bodies, Frames, Points
from .state.jacobians import jacobians
from .state.reactions import JointLinks, joint_links, reaction_sensitivities_of, reactions_of
from .state.weighted_gradients import WeightedGradients
from .statics.equilibrium import Equilibrium
from .statics.linearization import Linearization
from .statics.statics import Statics
from .trajectory.trajectory import Trajectory
from .trust.diagnose import Diagnosing
from .trust.diagnosis import Diagnosis
from .trust.precision import PartitionModules, extended


class Solver(Package):
    """A generated solver. May be used by several threads at once.

    Parameters
    ----------
    folder : path
        The generated package.
    target : {"c", "numpy", "both"}, optional
        Which code computes; left out: what the package was generated for. With "both" the two are compared first, then
        the C computes. Without a C compiler the NumPy module serves, and a warning says so.

    Raises
    ------
    CompileError
    TargetsDifferError

    Notes
    -----
    Arguments of the methods, all in SI units and radians: coordinates ``q (..., nq)``, speeds ``u (..., nu)``, design
    parameters ``p (..., np)`` (left out: `parameters`), ``inputs (..., ninputs)`` (left out: zeros), time ``t (...)``.
    Leading axes are batch axes and broadcast by NumPy's rules. Seeds carry their k directions first:
    ``dq (k, ..., nq)``, ``du``, ``dp``, ``dinputs`` alike, ``dt (k, ...)``; one without k counts as k = 1; missing ones
    are zero. ``p``, ``inputs`` and seeds may be mappings from some names to numbers. Results are (..., n), derivatives
    (k, ..., n).

    Every method raises ValueError for a wrong shape, a number that is not finite, an unknown name and a quaternion
    shorter than 1e-6. Methods that solve for accelerations raise `SingularJointError`.
    """

    def _is_used(self) -> None:
        if self._watched or self._opened.manifest.get("dropped"):
            from .assembly.redundancy import Redundancy

            of_redundancy = Redundancy(self)
            of_redundancy.watch_calls()
            self._watch = of_redundancy.look_at_directions
        if "scalar" in self._manifest and "assemble" not in self.__dict__:
            from .trust.single_precision import InDouble

            InDouble(self).put_in_place()

    # -- dynamics ------------------------------------------------------------------------------------------------------

    def accelerations(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        out: Array | None = None,
    ) -> Array:  # fmt: skip
        """The derivatives of the speeds, udot (..., nu), by Eqs. 18-24 and 42-56."""
        return self._call("accelerations", (q, u, p, inputs, t), None, out)[0]

    def sensitivities(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None,
        out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """udot (..., nu) and its total derivative (k, ..., nu) along the seeds (Eqs. 9, 10), exact to rounding."""
        return self._call("sensitivities", (q, u, p, inputs, t), (dq, du, dp, dinputs, dt), out)

    def jacobians(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        wrt: str | Sequence[str] | None = None, out: Jacobians | None = None,
    ) -> Jacobians:  # fmt: skip
        """The partial derivatives of udot, or those by what `wrt` names, ``"q, u"``; the others are not computed, and None."""
        return jacobians(self, (q, u, p, inputs, t), wrt, out)

    def coordinate_rates(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        out: Array | None = None,
    ) -> Array:  # fmt: skip
        """The derivatives of the coordinates, qdot (..., nq), by Eq. 1."""
        return self._call("coordinate_rates", (q, u, p, inputs, t), None, out)[0]

    def coordinate_rate_sensitivities(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None,
        out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """qdot (..., nq) and its total derivative (k, ..., nq) along the seeds."""
        return self._call("coordinate_rate_sensitivities", (q, u, p, inputs, t), (dq, du, dp, dinputs, dt), out)

    # -- consistent states ---------------------------------------------------------------------------------------------

    @property
    def initial(self) -> tuple[Array, Array]:
        """The model's initial state (q, u) at the default parameters, assembled."""
        return self.initial_state()

    def initial_state(self, p: Numbers = None) -> tuple[Array, Array]:
        """The model's initial state (q, u) at some parameters, assembled: initial values may be expressions of them.

        Of a model that begins in equilibrium it is the state of rest that the initial values lead to, inputs of zero, t = 0.
        """
        return self._states.initial_state(p)

    def initial_sensitivities(self, p: Numbers = None, *, dp: Numbers) -> tuple[Array, Array, Array, Array]:
        """The state of `initial_state` and its derivatives: q, u, dq (k, ..., nq), du (k, ..., nu).

        Where initial values depend on parameters, theirs are part of it, and loops stay closed.
        """
        return self._states.initial_sensitivities(p, dp)

    def assemble(
        self, q: Numbers = None, u: Numbers = None, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        follow: bool | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """A consistent state (q, u): loops closed, quaternions of unit length.

        Loops stay on the branch of the guess. A guess whose dependent coordinates are those of a closed state, at other
        independent coordinates or another time, is followed from there as a motion along the straight way would go; so is the
        initial state, from the default parameters and t = 0 too.

        Parameters
        ----------
        q, u : (..., nq) and (..., nu), optional
            The guess; its independent entries are kept, dependent ones are changed. What is left out is the model's initial
            state.
        follow : bool, optional
            Whether the states along the last axis of a batch are a path: each is followed from the one before it, whatever its
            own dependent entries are, and the first from its guess. Left out: along the axis of t where motion is prescribed
            and all times have the same guess, else not.

        Raises
        ------
        AssemblyError
            Names the loop and what is left of its conditions, or where its branch ends on the way.

        Warns
        -----
        RuntimeWarning
            Where the branch is in doubt: loops lose rank on the way, or the guess is far from any closed state.

        Examples
        --------
        >>> q, u = solver.assemble({"crank": np.linspace(0.0, 6.28, 100)}, follow=True)
        """
        return self._states.assemble(q, u, p, inputs, t, follow)

    def assemble_sensitivities(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None,
        follow: bool | None = None,
    ) -> tuple[Array, Array, Array, Array]:  # fmt: skip
        """A consistent state and its derivatives along the seeds: q, u, dq (k, ..., nq), du (k, ..., nu).

        Only the independent entries of the seeds are read; the dependent ones follow from closure. `follow` as for
        `assemble`.
        """
        return self._states.assemble_sensitivities((q, u, p, inputs, t), (dq, du, dp, dinputs, dt), follow)

    def closure(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0
    ) -> tuple[Array, Array]:
        """Scaled residuals of the loops in position and velocity, (..., len(closure_names)) each.

        Linear conditions are divided by the loop's characteristic length; the velocities are those of u as it is given.
        """
        return self._call("closure", (q, u, p, inputs, t))

    def closure_sensitivities(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """Scaled position residuals (..., len(closure_names)), and by how much completed seeds open them, (k, ..., the same).

        The latter is zero to rounding unless conditions are redundant and a direction does not keep them, such as a
        parameter that bends a planar loop out of its plane: then no derivative exists along it.
        """
        return self._call("closure_sensitivities", (q, u, p, inputs, t), (dq, du, dp, dinputs, dt))

    @functools.cached_property
    def _states(self) -> States:
        """What assembles states; of mechanisms with loops it closes them."""
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
        """Names of the independent coordinates of each partition that the package holds, one to four."""
        return partition_names(self)

    @property
    def partition(self) -> int:
        """The partition in use."""
        return self._opened.number

    def use_partition(self, partition: int) -> None:
        """Take other independent coordinates from now on; states keep their meaning, since q and u hold all coordinates and
        speeds.

        Not while other threads use this solver.
        """
        use_partition(self, partition)

    def condition(self, q: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0) -> Array:
        """Worst condition of the closure matrices of the dependent speeds, for each partition, (..., len(partitions)).

        One is best; infinite where a loop has lost rank, as at a dead point of the independent coordinates. The figure says how
        far dependent speeds move per unit of what opens a loop: the Frobenius norm of the inverse of the matrix, times that of
        the matrix, at least sqrt(n), over the number n of dependent speeds; of a single one, one over its entry. Linear
        conditions and displacements are in parts of the characteristic length. Other threads may use the solver meanwhile: the
        partition in use stays.
        """
        return conditions(self, q, p, inputs, t)

    # -- statics -------------------------------------------------------------------------------------------------------

    def equilibrium(
        self, q: Numbers = None, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        sensitivities: str | Sequence[str] = (), relax: bool = False, tolerance: float = 1e-9,
    ) -> Equilibrium:  # fmt: skip
        """A state of rest near a guess: u = 0 and udot = 0, for trees and loops.

        Newton's method in the tangent space, with exact Jacobians, finds the equilibrium that the guess leads to, stable or
        not. Where it leads to none, the mechanism is let sink to rest from the guess; where forces have a potential, what is
        found then is stable. Forces that depend on speeds are taken at u = 0, those that depend on time at t. Steady rotation
        is no state of rest: a mechanism that spins is out of scope.

        Parameters
        ----------
        q : (nq,), optional
            The guess; left out: the model's initial coordinates. Dependent ones follow.
        p, inputs, t : (np,), (ninputs,), number
        sensitivities : names, optional
            Parameters, and inputs as ``inputs.motor``, by which q is differentiated: ``("length", "inputs.motor")``.
        relax : bool, optional
            Let the mechanism sink to rest first: where forces have a potential the equilibrium is stable, though it may not be
            the one nearest to the guess.
        tolerance : float, optional
            The largest acceleration that counts as none, rad/s^2 or m/s^2, against one plus those that a small motion of
            1 rad or 1 m would make. Newton's method goes on below it as long as it gets better, as a rule to rounding.

        Returns
        -------
        Equilibrium
            q, u, dq, stable, neutral and what was left. Near a loss of rank of a loop, where these are not determined, a
            warning says so, and `stable` is None.

        Raises
        ------
        EquilibriumError
            None was found; names the coordinate with the largest acceleration.
        AssemblyError
            The guess cannot be closed.
        """
        return self._statics.equilibrium(q, p, inputs, t, sensitivities, relax, tolerance)

    def linearize(
        self, q: Numbers = None, u: Numbers = None, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        outputs: str | Sequence[str] | None = None,
    ) -> Linearization:  # fmt: skip
        """The linearised equations of motion about a state, ``x' = A x + B dinputs`` and ``dy = C x + D dinputs``, exact.

        The states x are n small motions w along the independent speeds, ``state_names`` such as ``q.crank``, then n changes v
        of these speeds, ``u.crank``. Small motions of quaternions are small rotations in the axes of their speeds,
        ``rotation.ball.wx``, and positions of free joints move along theirs, ``displacement.bus.vx``: ``dq = N w`` where
        ``qdot = N u``, so that A has no superfluous rows. Dependent coordinates and speeds follow, as everywhere.

        Differentiating ``qdot = N u`` along a motion gives, D being derivatives with respect to q,

            w' = v + N^+ (D(N u)[N w] - D(N w)[N u])        v' = D udot[N w] + (d udot/du) v

        At rest w' = v. In motion the other term is not zero for quaternions and free joints, whose axes turn with the body:
        w' = v + w x u for a rotation. About a state that moves, A is that of the instant, as are forces that depend on t.

        Parameters
        ----------
        q : (nq,), optional
            Left out: the model's initial coordinates. Dependent ones follow.
        u : (nu,), optional
            Left out: at rest.
        p, inputs, t : (np,), (ninputs,), number
        outputs : names, optional
            The outputs in C and D; left out: all, if the package has their derivatives.

        Returns
        -------
        Linearization
            A, B, C, D with names; eigenvalues, modes, and derivatives of all these by parameters.
        """
        return self._statics.linearize(q, u, p, inputs, t, outputs)

    @functools.cached_property
    def _statics(self) -> Statics:
        return Statics(self, self._states)

    # -- diagnosis -----------------------------------------------------------------------------------------------------

    def diagnose(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None, derivatives: bool = True,
    ) -> Diagnosis:  # fmt: skip
        """Rounding errors of udot and of its derivatives, condition numbers, and what is near a loss of rank, at one state.

        Errors are estimated by the code itself: it runs once more with every operation rounded up, and once rounded down. So
        udot takes three evaluations, and derivatives as many of theirs. This follows the algorithm, whose errors grow with
        none of the condition numbers in general, and is right within a factor of 30 as a rule (docs/theory.md, section 9).
        Errors of the arguments are not in it: `argument_error` says what a unit in their last places does (four evaluations).

        Parameters
        ----------
        q, u, p, inputs, t
            One state. Not assembled: `gap` says how far loops are open.
        dq, du, dp, dinputs, dt : optional
            Seeds of the derivatives; left out: independent coordinates and speeds, parameters, inputs and t, each by itself.
        derivatives : bool
            Whether there are any.

        Returns
        -------
        Diagnosis
            Print it to have it in words. A state at which rank is lost is a diagnosis too, and no error.
        """
        return self._diagnoses.diagnose((q, u, p, inputs, t), (dq, du, dp, dinputs, dt), derivatives)

    @functools.cached_property
    def _diagnoses(self) -> Diagnosing:
        return Diagnosing(self)

    # -- weighted gradients --------------------------------------------------------------------------------------------

    def gradients(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, weights: Numbers
    ) -> Gradients:
        """Gradients of ``sum_i weights_i udot_i``: ``weights^T J`` of all Jacobians of udot at once, exact to rounding.

        Parameters
        ----------
        weights : (k, ..., nu)
            Of the entries of udot, for each of k sums; (nu,) for one.

        Returns
        -------
        Gradients
        """
        return self._gradients.of("sensitivities_transposed", (q, u, p, inputs, t), (weights,))

    def coordinate_rate_gradients(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, weights: Numbers
    ) -> Gradients:
        """Gradients of weighted sums of the time derivatives of the coordinates; weights (k, ..., nq)."""
        return self._gradients.of("coordinate_rate_sensitivities_transposed", (q, u, p, inputs, t), (weights,))

    def energy_gradients(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, weights: Numbers
    ) -> Gradients:
        """Gradients of weighted sums of kinetic and potential energy; weights (k, ..., 2)."""
        return self._gradients.of("energy_sensitivities_transposed", (q, u, p, inputs, t), (weights,))

    def output_gradients(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, weights: Numbers
    ) -> Gradients:
        """Gradients of weighted sums of the model's outputs; weights (k, ..., noutputs)."""
        return self._gradients.of("output_sensitivities_transposed", (q, u, p, inputs, t), (weights,))

    def assemble_gradients(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        weights_q: Numbers = None, weights_u: Numbers = None,
    ) -> Gradients:  # fmt: skip
        """Gradients of weighted sums of the assembled state, with respect to what it is assembled from.

        Parameters
        ----------
        weights_q, weights_u : (k, ..., nq) and (k, ..., nu), optional
            Of the assembled coordinates and speeds.
        """
        return self._gradients.of_assembled((q, u, p, inputs, t), weights_q, weights_u)

    @functools.cached_property
    def _gradients(self) -> WeightedGradients:
        return WeightedGradients(self, self._states)

    # -- energies ------------------------------------------------------------------------------------------------------

    def energies(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0
    ) -> tuple[Array, Array]:
        """Kinetic and potential energy, (...) each, J; gravity's is zero at the ground's origin."""
        (energy,) = self._call("energies", (q, u, p, inputs, t))
        return energy[..., 0], energy[..., 1]

    def energy_sensitivities(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None,
    ) -> tuple[tuple[Array, Array], tuple[Array, Array]]:  # fmt: skip
        """Kinetic and potential energy, and their total derivatives: (T, V), (dT, dV), dT and dV (k, ...)."""
        energy, denergy = self._call("energy_sensitivities", (q, u, p, inputs, t), (dq, du, dp, dinputs, dt))
        return (energy[..., 0], energy[..., 1]), (denergy[..., 0], denergy[..., 1])

    # -- outputs -------------------------------------------------------------------------------------------------------

    def outputs(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        out: Array | None = None,
    ) -> Array:  # fmt: skip
        """The model's outputs (..., noutputs), in the order of `output_names`."""
        return self._call("outputs", (q, u, p, inputs, t), None, out)[0]

    def output_sensitivities(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None,
        out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """The model's outputs (..., noutputs) and their total derivative (k, ..., noutputs) along the seeds."""
        return self._call("output_sensitivities", (q, u, p, inputs, t), (dq, du, dp, dinputs, dt), out)

    # -- forces --------------------------------------------------------------------------------------------------------

    def mass_matrix(
        self, q: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, out: Array | None = None
    ) -> Array:
        """The mass matrix M of Eq. 4, (..., nu, nu); of `inputs` and `t` prescribed motion makes use."""
        return self._call("mass_matrix", (q, None, p, inputs, t), None, out)[0]

    def mass_matrix_sensitivities(
        self, q: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None, out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """M (..., nu, nu) and its total derivative (k, ..., nu, nu) along the seeds."""
        return self._call("mass_matrix_sensitivities", (q, None, p, inputs, t), (dq, None, dp, dinputs, dt), out)

    def inverse_dynamics(
        self, q: Numbers, u: Numbers, udot: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        out: Array | None = None,
    ) -> Array:  # fmt: skip
        """The joint forces (..., nu) that udot (..., nu) needs beside the model's own: M udot - K."""
        return self._call("inverse_dynamics", (q, u, p, inputs, t, udot), None, out)[0]

    def inverse_dynamics_sensitivities(
        self, q: Numbers, u: Numbers, udot: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        dq: Numbers = None, du: Numbers = None, dudot: Numbers = None, dp: Numbers = None, dinputs: Numbers = None,
        dt: Times | None = None, out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """The joint forces of `inverse_dynamics` and their total derivative (k, ..., nu); ``dudot (k, ..., nu)``."""
        given, along = (q, u, p, inputs, t, udot), (dq, du, dp, dinputs, dt, dudot)
        return self._call("inverse_dynamics_sensitivities", given, along, out)

    def bias_force(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        out: Array | None = None,
    ) -> Array:  # fmt: skip
        """The joint forces (..., nu) that hold udot at zero, -K of Eq. 4: M udot + bias_force = 0."""
        return self._call("inverse_dynamics", (q, u, p, inputs, t, np.zeros(self.nu)), None, out)[0]

    def bias_force_sensitivities(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None,
        out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """The forces of `bias_force` and their total derivative (k, ..., nu) along the seeds."""
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
        """The inverse of the mass matrix, (..., nu, nu), in O(n^2): M is not formed. Its columns are those of `solve_mass`."""
        return self._call("inverse_mass_matrix", (q, None, p, inputs, t), None, out)[0]

    def solve_mass(
        self, q: Numbers, b: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        out: Array | None = None,
    ) -> Array:  # fmt: skip
        """The solution x (..., nu) of M x = b for generalised forces b (..., nu), in O(n)."""
        return self._call("solve_mass", (q, None, p, inputs, t, b), None, out)[0]

    def solve_mass_sensitivities(
        self, q: Numbers, b: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        db: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None,
        out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """x (..., nu) of M x = b and its total derivative (k, ..., nu) along the seeds; ``db (k, ..., nu)``."""
        along = (dq, None, dp, dinputs, dt, db)
        return self._call("solve_mass_sensitivities", (q, None, p, inputs, t, b), along, out)

    # -- driving forces ------------------------------------------------------------------------------------------------

    def driving_forces(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, out: Array | None = None
    ) -> Array:  # fmt: skip
        """The generalised force, N m or N, along each of `prescribed_names`, (..., nprescribed).

        It is what has to act there beside the model's own forces for the coordinate to move as it is prescribed; its power is
        force times rate.
        """
        return self._call("driving_forces", (q, u, p, inputs, t), None, out)[0]

    def driving_force_sensitivities(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None,
        out: tuple[Array, Array] | None = None,
    ) -> tuple[Array, Array]:  # fmt: skip
        """`driving_forces` and their total derivative (k, ..., nprescribed) along the seeds."""
        return self._call("driving_force_sensitivities", (q, u, p, inputs, t), (dq, du, dp, dinputs, dt), out)

    # -- reactions -----------------------------------------------------------------------------------------------------

    def reactions(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0
    ) -> tuple[Array, Array]:
        """What joints and loops transmit, in the ground frame: moment, N m, then force, N.

        Needs a package that was generated with reactions.

        Returns
        -------
        joints : (..., nbodies, 6)
            What the joint of each body does to it, about the body's origin, the joint's own force included. NaN for a body on a
            fixed joint: it is one with what carries it.
        loops : (..., nloops, 6)
            What each loop joint does to its ``to`` body, about the origin of the face there. Where conditions are redundant
            they are not unique: these are, ear by ear, the ones with the least sum of squares of moments, and forces
            times the characteristic length.
        """
        return reactions_of(self._joint_links, self._call("reactions", (q, u, p, inputs, t)))

    def reaction_sensitivities(
        self, q: Numbers, u: Numbers, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *, dq: Numbers = None,
        du: Numbers = None, dp: Numbers = None, dinputs: Numbers = None, dt: Times | None = None,
    ) -> tuple[Array, Array, Array, Array]:  # fmt: skip
        """`reactions` and their total derivatives along the seeds.

        Through closed loops seeds of dependent coordinates and speeds follow from the others. Where conditions are
        redundant it is the derivative of the reactions that `reactions` gives.

        Returns
        -------
        joints : (..., nbodies, 6)
        loops : (..., nloops, 6)
        djoints : (k, ..., nbodies, 6)
            Of the components in the ground frame, N m and N per unit of the seed. NaN where `joints` is.
        dloops : (k, ..., nloops, 6)
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
        """Where bodies are, how they turn and move, and with `accelerations` how these change.

        Needs a package that was generated with frames. Through closed loops as over a tree: dependent speeds follow from the
        others, coordinates are taken as they are passed.

        Parameters
        ----------
        u : (..., nu), optional
            Zero if left out.
        bodies : str or sequence of str, optional
            One alone, whose arrays are without the axis n, or several; left out: all, in the order of the model.
        accelerations : bool
            Accelerations too, which take the forward dynamics.

        Returns
        -------
        FrameMotion
            In the ground frame.
        """
        return self._frames.frames((q, u, p, inputs, t), bodies, accelerations)

    def frame_sensitivities(
        self, q: Numbers, u: Numbers = None, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        bodies: Bodies = None, accelerations: bool = False, dq: Numbers = None, du: Numbers = None, dp: Numbers = None,
        dinputs: Numbers = None, dt: Times | None = None,
    ) -> tuple[FrameMotion, FrameMotion]:  # fmt: skip
        """Motions of bodies, see `frames`, and their total derivatives along the seeds.

        Returns
        -------
        FrameMotion
        FrameMotion
            Derivatives, with the k directions first: ``rotation (k, ..., n, 3, 3)``, ``position (k, ..., n, 3)`` and so on.
        """
        return self._frames.frame_sensitivities((q, u, p, inputs, t), (dq, du, dp, dinputs, dt), bodies, accelerations)

    def frame_jacobians(
        self, q: Numbers, u: Numbers = None, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        bodies: Bodies = None,
    ) -> Array:  # fmt: skip
        """Geometric Jacobians of bodies: what a unit of each speed adds to angular velocity and velocity of the origin.

        Returns
        -------
        (..., n, 6, nu)
            Rows: angular velocity, velocity, along the ground's axes. Columns of dependent speeds are zero, as what follows from
            the independent ones is in the columns of these; so times u it is the velocity. It does not depend on u.
        """
        return self._frames.frame_jacobians(q, p, inputs, t, bodies)

    def points(
        self, q: Numbers, u: Numbers = None, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        points: Points = None, accelerations: bool = False,
    ) -> PointMotion:  # fmt: skip
        """Where points fixed in bodies are, and how they move.

        Parameters
        ----------
        u : (..., nu), optional
            Zero if left out.
        points : optional
            A list of points or one alone, whose arrays are without the axis n: the name of a point of the model, that of a body
            for its origin, or a pair of a body (or ``"ground"``) and a place (3,) in its frame, m. Left out: all points of the
            model.
        accelerations : bool
            Accelerations too, which take the forward dynamics.

        Returns
        -------
        PointMotion
            In the ground frame.
        """
        return self._frames.points((q, u, p, inputs, t), points, accelerations)

    def point_sensitivities(
        self, q: Numbers, u: Numbers = None, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        points: Points = None, accelerations: bool = False, dq: Numbers = None, du: Numbers = None, dp: Numbers = None,
        dinputs: Numbers = None, dt: Times | None = None,
    ) -> tuple[PointMotion, PointMotion]:  # fmt: skip
        """Motions of points, see `points`, and their total derivatives along the seeds.

        The place of a point of the model in its body may depend on parameters, and that is part of the derivative along dp;
        places that are given are constants.

        Returns
        -------
        PointMotion
        PointMotion
            Derivatives, with the k directions first: ``position (k, ..., n, 3)`` and so on.
        """
        return self._frames.point_sensitivities((q, u, p, inputs, t), (dq, du, dp, dinputs, dt), points, accelerations)

    def point_jacobians(
        self, q: Numbers, u: Numbers = None, p: Numbers = None, inputs: Numbers = None, t: Times = 0.0, *,
        points: Points = None,
    ) -> Array:  # fmt: skip
        """Geometric Jacobians of points: what a unit of each speed adds to the angular velocity of its body and to its velocity.

        Returns
        -------
        (..., n, 6, nu)
            See `frame_jacobians`.
        """
        return self._frames.point_jacobians(q, p, inputs, t, points)

    @functools.cached_property
    def _frames(self) -> Frames:
        return Frames(self)

    # -- motions -------------------------------------------------------------------------------------------------------

    def simulate(
        self, t: Any, q: Numbers = None, u: Numbers = None, p: Numbers = None, inputs: Any = None, *,
        sensitivities: Sequence[str] | str = (), dq0: Numbers = None, du0: Numbers = None, rtol: float = 1e-9,
        atol: Any = 1e-9, atol_sensitivities: Any = None, method: str = "dop853", step: float | None = None,
        largest_step: float | None = None, most_steps: int = MOST_STEPS, events: Any = (), progress: Progress | None = None,
        on_failure: str = "raise",
    ) -> Trajectory:  # fmt: skip
        """Integrate the motion over time, and its derivatives with it (Eqs. 2, 3), in compiled code.

        Parameters
        ----------
        t : float or (nt,)
            Times of results, rising; the motion begins at the first. A number T means from 0 to T, at the steps' ends.
        q, u : (nq,) and (nu,), optional
            The initial state; dependent speeds follow from closure, loops that are open are closed, and a warning says so. What
            is left out is the model's initial state, whose dependence on parameters is part of the derivatives.
        p : (np,), optional
        inputs : (nsignals,), or (times, values), or (times, values, kind), or function, or spline, or mapping, optional
            Constants; or values (ntimes, nsignals), by `kind` held from each time on ("hold"), joined by straight lines
            ("linear", if not said), by a spline through them ("cubic", "quintic"), or control points of a cubic B-spline whose
            knots are times ("spline", ntimes + 2 of them); a function of time, which a spline of degree 9 replaces; SciPy's
            `BSpline` or `PPoly`; or by name any of these for one signal. Before their first and after their last time signals
            are held. Those that prescribed motion reads need a continuous velocity, and bring their rates and accelerations.
        sensitivities : sequence of str
            What derivatives are with respect to: parameters, ``q0.NAME`` and ``u0.NAME`` for initial values of independent
            coordinates and speeds, ``inputs.NAME`` for a number added to an input, ``inputs.NAME[i]`` for its i-th value. A
            parameter that is a vector, and the joint of several freedoms, stand for their entries.
        dq0, du0 : (k, nq) and (k, nu), optional
            Derivatives of the initial state in place of those that follow from `sensitivities`; independent entries are read.
        rtol : float
        atol : float or (nq + nu,)
            The error of a step that is allowed in each independent coordinate and speed: atol + rtol times its size.
        atol_sensitivities : float or (k,), optional
            The same for derivatives, with the same rtol. Left out: steps are chosen for the state alone; then derivatives are
            those of the computed motion to rounding all the same.
        method : {"dop853", "radau", "rk4"}
            Dormand and Prince's of order 8; Radau IIA of order 5 for stiff models; the classical one with constant `step`.
        step, largest_step : float, optional
            The first step, or that of "rk4", s; none is larger than `largest_step`.
        most_steps : int
        events : sequence of `Event` or str, optional
            Outputs that cross a level, zero for a mere name; a motion ends at the first one with `stop`. See `Trajectory.events`.
        progress : callable, optional
            Called as ``progress(time, end)`` about ten times a second; KeyboardInterrupt in it ends the motion there.
        on_failure : {"raise", "return"}
            What is done when a motion cannot go on: `SimulationError` with the trajectory so far, or the latter with a warning.

        Returns
        -------
        Trajectory

        Raises
        ------
        SimulationError
            Names time and cause; its `trajectory` has everything before it.
        AssemblyError, ValueError
        """
        # long: eighteen arguments, each with its meaning
        return self._motions.simulate(
            t,
            q,
            u,
            p,
            inputs,
            sensitivities,
            dq0,
            du0,
            rtol,
            atol,
            atol_sensitivities,
            method,
            step,
            largest_step,
            most_steps,
            events,
            progress,
            on_failure,
        )

    def judge(
        self, t: Any, functionals: Functional | Sequence[Functional], q: Numbers = None, u: Numbers = None, p: Numbers = None,
        inputs: Any = None, *, wrt: Sequence[str] | str = (), method: str = "auto", dq0: Numbers = None, du0: Numbers = None,
        rtol: float = 1e-9, atol: Any = 1e-9, integrator: str = "dop853", step: float | None = None,
        largest_step: float | None = None, most_steps: int = MOST_STEPS, memory: int = MEMORY,
    ) -> Judged:  # fmt: skip
        """Values of functionals of a motion, and their gradients, exact for the steps that are made.

        Parameters
        ----------
        t : float, or (start, end)
            The motion's end, s, or both ends.
        functionals : one or several of `Final`, `At`, `Integral`, `AtEvent`, `LeastSquares`
        q, u, p, inputs, dq0, du0, rtol, atol, step, largest_step, most_steps
            As those of `simulate`.
        wrt : sequence of str
            What gradients are with respect to, as the `sensitivities` of `simulate`.
        method : {"auto", "forward", "adjoint"}
            Sensitivities along with the motion, or the discrete adjoint, whose cost does not grow with the number of parameters;
            "auto" takes what costs less. Both give the same to rounding.
        integrator : {"dop853", "radau", "rk4"}
        memory : int
            Bytes that the adjoint keeps steps in.

        Returns
        -------
        Judged

        Raises
        ------
        SimulationError
            The motion ends before its time, or an event that is asked for does not come.
        """
        return self._motions.judge(
            t,
            functionals,
            q,
            u,
            p,
            inputs,
            wrt,
            method,
            dq0,
            du0,
            rtol,
            atol,
            integrator,
            step,
            largest_step,
            most_steps,
            memory,
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
        """This solver in more digits, to settle a doubt about rounding: the same statements on longer numbers.

        Its members take what those of this solver take, and mpmath's numbers and decimal text too; floats count as exactly
        what they are. They return mpmath's numbers in arrays of objects, which keep these digits whatever ``mpmath.mp.dps``
        is; ``.astype(float)`` rounds an array to doubles. `assemble` closes loops to these digits; the other members take
        coordinates as they are given, as everywhere. Of a model that begins in equilibrium, `initial` is the state of rest
        that double precision finds. There are no `simulate`, `judge`, `equilibrium`, `linearize` and `diagnose`. Numbers that
        were computed from the model when it was generated are the doubles that stand in the package.

        Parameters
        ----------
        digits : int
            Decimal digits of results, at least 16; what is computed with has ten more. Cancellation takes digits away, so
            compare with those of more.
        model : Model or path, optional
            What the package was generated from: numbers that were computed from it are computed in these digits too, from the
            doubles that the model file is read as. Needs a solver that `ordernm.load` has opened.

        Returns
        -------
        Solver
            With ``digits``, and ``mp``, mpmath's functions in these digits.

        Raises
        ------
        ImportError
            mpmath is not installed.
        ValueError
            `digits` are too few or too many, or the package was generated from another model.
        """
        return extended(self, digits, None if model is None else self._extended_modules(model, digits))

    def _extended_modules(self, model: Any, digits: int) -> PartitionModules:
        """The NumPy module of each partition with the numbers of a model in more digits, which its generator writes."""
        raise ValueError("model: a package by itself generates nothing; open it with ordernm.load to give its model")
