/* Pinocchio's two ways to the accelerations of LADDER(L) and PINNED(n), callable from C; see loops_against_pinocchio.py.
 *
 * JOINTS chooses its collection of joint types: HingesOnly, or pinocchio::JointCollectionDefaultTpl.
 */
#include "pinocchio_mechanisms.hpp"

#include <pinocchio/algorithm/constrained-dynamics.hpp>
#include <pinocchio/algorithm/loop-constrained-aba.hpp>

#ifndef JOINTS
#define JOINTS HingesOnly
#endif

namespace
{
typedef Mechanism<double, JOINTS> Doubles;

struct Solver : Doubles
{
    Doubles::Data data;
    Eigen::VectorXd force;
    pinocchio::ProximalSettings settings;

    /* linear: for lcaba, which has an order of elimination of its own; otherwise for constraintDynamics. */
    Solver(bool linear, bool ladder, int size, double mu, double accuracy, int iterations)
        : Doubles(ladder, size, 1.0), data(model), force(Eigen::VectorXd::Zero(model.nv)), settings(accuracy, mu, iterations)
    {
        if (linear)
            pinocchio::computeJointMinimalOrdering(model, data, loops);
        else
            pinocchio::initConstraintDynamics(model, data, loops, loop_data);
    }
};

typedef Eigen::Map<const Eigen::VectorXd> Numbers;

void copy(const Solver &s, double *udot) { Eigen::Map<Eigen::VectorXd>(udot, s.model.nv) = s.data.ddq; }
}

extern "C" {

void *pinocchio_make(int linear, int ladder, int size, double mu, double accuracy, int iterations)
{
    return new Solver(linear, ladder, size, mu, accuracy, iterations);
}

/* Linear in the number of bodies, by proximal iterations. Returns how many. */
int pinocchio_lcaba(void *solver, const double *q, const double *u, double *udot)
{
    Solver &s = *static_cast<Solver *>(solver);
    const int n = s.model.nv;
    pinocchio::lcaba(s.model, s.data, Numbers(q, n), Numbers(u, n), s.force, s.loops, s.loop_data, s.settings);
    copy(s, udot);
    return s.settings.iter;
}

/* Sparse Cholesky of the system with multipliers, and proximal iterations where conditions are redundant. */
int pinocchio_constraint_dynamics(void *solver, const double *q, const double *u, double *udot)
{
    Solver &s = *static_cast<Solver *>(solver);
    const int n = s.model.nv;
    pinocchio::constraintDynamics(s.model, s.data, Numbers(q, n), Numbers(u, n), s.force, s.loops, s.loop_data, s.settings);
    copy(s, udot);
    return s.settings.iter;
}
}
