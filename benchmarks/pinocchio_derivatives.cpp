/* Pinocchio's Jacobians of the accelerations, its mass matrix and its second derivatives of inverse dynamics, callable from C; see
 * jacobians_against_pinocchio.py and second_order_against_pinocchio.py.
 *
 * A model is a list of numbers, for each joint: parent, type (0 revolute, 1 prismatic, 2 free), axis, rotation matrix by rows,
 * place, mass, centre of mass, inertia about it by rows. JOINTS chooses the collection of joint types.
 */
#include <pinocchio/algorithm/aba-derivatives.hpp>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/rnea-second-order-derivatives.hpp>
#include <pinocchio/multibody.hpp>
#include <pinocchio/multibody/joint.hpp>

#include <string>

#ifndef JOINTS
#define JOINTS FewJoints
#endif

namespace
{
template<typename S, int O = 0>
struct FewJoints
{
    typedef S Scalar;
    enum { Options = O };
    typedef pinocchio::JointModelRevoluteTpl<S, O, 0> JointModelRX;
    typedef pinocchio::JointModelRevoluteTpl<S, O, 1> JointModelRY;
    typedef pinocchio::JointModelRevoluteTpl<S, O, 2> JointModelRZ;
    typedef pinocchio::JointModelRevoluteUnalignedTpl<S, O> JointModelRevoluteUnaligned;
    typedef pinocchio::JointModelPrismaticUnalignedTpl<S, O> JointModelPrismaticUnaligned;
    typedef pinocchio::JointModelFreeFlyerTpl<S, O> JointModelFreeFlyer;
    typedef pinocchio::JointModelCompositeTpl<S, O, FewJoints> JointModelComposite;
    typedef pinocchio::JointModelMimicTpl<S, O, FewJoints> JointModelMimic;
    typedef boost::variant<JointModelRX, JointModelRY, JointModelRZ, JointModelRevoluteUnaligned, JointModelPrismaticUnaligned,
                           JointModelFreeFlyer, boost::recursive_wrapper<JointModelComposite>,
                           boost::recursive_wrapper<JointModelMimic>> JointModelVariant;
    typedef pinocchio::JointDataRevoluteTpl<S, O, 0> JointDataRX;
    typedef pinocchio::JointDataRevoluteTpl<S, O, 1> JointDataRY;
    typedef pinocchio::JointDataRevoluteTpl<S, O, 2> JointDataRZ;
    typedef pinocchio::JointDataRevoluteUnalignedTpl<S, O> JointDataRevoluteUnaligned;
    typedef pinocchio::JointDataPrismaticUnalignedTpl<S, O> JointDataPrismaticUnaligned;
    typedef pinocchio::JointDataFreeFlyerTpl<S, O> JointDataFreeFlyer;
    typedef pinocchio::JointDataCompositeTpl<S, O, FewJoints> JointDataComposite;
    typedef pinocchio::JointDataMimicTpl<S, O, FewJoints> JointDataMimic;
    typedef boost::variant<JointDataRX, JointDataRY, JointDataRZ, JointDataRevoluteUnaligned, JointDataPrismaticUnaligned,
                           JointDataFreeFlyer, boost::recursive_wrapper<JointDataComposite>,
                           boost::recursive_wrapper<JointDataMimic>> JointDataVariant;
};

typedef Eigen::Map<const Eigen::VectorXd> Numbers;
typedef Eigen::Map<const Eigen::Vector3d> Vector;
typedef Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> Matrix;

struct Solver
{
    typedef pinocchio::ModelTpl<double, 0, JOINTS> Model;
    typedef pinocchio::DataTpl<double, 0, JOINTS> Data;
    typedef JOINTS<double, 0> Joints;
    Model model;
    Data data;
    Eigen::VectorXd q, u, tau;

    static Model made(int joints, const double *of)
    {
        Model model;
        model.gravity.linear() << 0, 0, -9.81;
        for (int k = 0; k < joints; ++k, of += 30) {
            const Vector axis(of + 2), place(of + 14), center(of + 18);
            const pinocchio::SE3 at(Matrix(of + 5), place);
            const pinocchio::JointIndex parent = (pinocchio::JointIndex)of[0];
            const std::string name = "j" + std::to_string(k);
            pinocchio::JointIndex i;
            if (of[1] == 2)
                i = model.addJoint(parent, typename Joints::JointModelFreeFlyer(), at, name);
            else if (of[1] == 1)
                i = model.addJoint(parent, typename Joints::JointModelPrismaticUnaligned(axis), at, name);
            else if (axis[0] == 1)
                i = model.addJoint(parent, typename Joints::JointModelRX(), at, name);
            else if (axis[1] == 1)
                i = model.addJoint(parent, typename Joints::JointModelRY(), at, name);
            else if (axis[2] == 1)
                i = model.addJoint(parent, typename Joints::JointModelRZ(), at, name);
            else
                i = model.addJoint(parent, typename Joints::JointModelRevoluteUnaligned(axis), at, name);
            const Eigen::Matrix3d inertia = Matrix(of + 21);
            model.appendBodyToJoint(i, pinocchio::Inertia(of[17], center, inertia), pinocchio::SE3::Identity());
        }
        return model;
    }

    Solver(int joints, const double *of)
        : model(made(joints, of)), data(model), q(model.nq), u(model.nv), tau(Eigen::VectorXd::Zero(model.nv))
    {
    }
};
}

extern "C" {
void *pinocchio_make(int joints, const double *of) { return new Solver(joints, of); }

int pinocchio_jacobians(void *solver, const double *q, const double *u, const double *tau)
{
    Solver &s = *(Solver *)solver;
    s.q = Numbers(q, s.model.nq);
    s.u = Numbers(u, s.model.nv);
    s.tau = Numbers(tau, s.model.nv);
    pinocchio::computeABADerivatives(s.model, s.data, s.q, s.u, s.tau);
    return 0;
}

int pinocchio_mass(void *solver, const double *q, int world)
{
    Solver &s = *(Solver *)solver;
    s.q = Numbers(q, s.model.nq);
    pinocchio::crba(s.model, s.data, s.q, world ? pinocchio::Convention::WORLD : pinocchio::Convention::LOCAL);
    return 0;
}

/* Second derivatives of sum_i weights_i force_i by q twice, u twice, q and u, udot and q: four matrices (nv, nv) by columns. */
int pinocchio_second(void *solver, const double *q, const double *u, const double *udot, const double *weights, double *found)
{
    Solver &s = *(Solver *)solver;
    const int n = s.model.nv;
    s.q = Numbers(q, s.model.nq);
    s.u = Numbers(u, n);
    s.tau = Numbers(udot, n);
    auto &d = s.data;
    for (auto *x : {&d.d2tau_dqdq, &d.d2tau_dvdv, &d.d2tau_dqdv, &d.d2tau_dadq})
        x->setZero();
    pinocchio::ComputeRNEASecondOrderDerivatives(s.model, d, s.q, s.u, s.tau);
    const Numbers w(weights, n);
    for (auto *x : {&d.d2tau_dqdq, &d.d2tau_dvdv, &d.d2tau_dqdv, &d.d2tau_dadq}) {
        /* the forces vary fastest */
        Eigen::Map<Eigen::VectorXd>(found, n * n).noalias() =
            Eigen::Map<const Eigen::MatrixXd>(x->data(), n, n * n).transpose() * w;
        found += n * n;
    }
    return 0;
}
}
