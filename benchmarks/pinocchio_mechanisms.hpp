/* LADDER(L) and PINNED(n) in Pinocchio, for loops_against_pinocchio.py; over any scalar, so that CppADCodeGen can record them.
 *
 * The mechanisms of examples/ladder.yaml and examples/pinned_chain.yaml: rods of 1 kg/m, radius 5 cm and one length, all
 * hinges about x or y. Coordinates come in the same order. A loop is a point of a rod that may not move in the ground.
 */
#pragma once
#include <pinocchio/constraints.hpp>
#include <pinocchio/multibody.hpp>
#include <pinocchio/multibody/joint.hpp>

#include <string>
#include <vector>

/* Joints about x and y only: a smaller variant for Pinocchio to dispatch on than its default of thirty joints.
 * Composite and mimic have to be there for it to compile. */
template<typename S, int options = 0>
struct HingesOnly
{
    typedef S Scalar;
    enum { Options = options };
    template<int axis> using HingeModel = pinocchio::JointModelRevoluteTpl<S, options, axis>;
    template<int axis> using HingeData = pinocchio::JointDataRevoluteTpl<S, options, axis>;
    typedef HingeModel<0> JointModelRX;
    typedef HingeModel<1> JointModelRY;
    typedef HingeData<0> JointDataRX;
    typedef HingeData<1> JointDataRY;
    typedef pinocchio::JointModelCompositeTpl<S, options, ::HingesOnly> JointModelComposite;
    typedef pinocchio::JointModelMimicTpl<S, options, ::HingesOnly> JointModelMimic;
    typedef pinocchio::JointDataCompositeTpl<S, options, ::HingesOnly> JointDataComposite;
    typedef pinocchio::JointDataMimicTpl<S, options, ::HingesOnly> JointDataMimic;
    typedef boost::variant<JointModelRX, JointModelRY, boost::recursive_wrapper<JointModelComposite>,
                           boost::recursive_wrapper<JointModelMimic>>
        JointModelVariant;
    typedef boost::variant<JointDataRX, JointDataRY, boost::recursive_wrapper<JointDataComposite>,
                           boost::recursive_wrapper<JointDataMimic>>
        JointDataVariant;
};

template<class S, template<typename, int> class Joints = HingesOnly>
struct Mechanism
{
    typedef pinocchio::ModelTpl<S, 0, Joints> Model;
    typedef pinocchio::DataTpl<S, 0, Joints> Data;
    typedef Eigen::Matrix<S, 3, 1> Vector;
    typedef pinocchio::SE3Tpl<S> Placement;

    Model model;
    std::vector<pinocchio::RigidConstraintModelTpl<S>> loops;
    std::vector<pinocchio::RigidConstraintDataTpl<S>> loop_data;

    Mechanism(bool ladder, int size, const S &length)
    {
        const S zero(0), half = length / S(2);
        const Vector origin(zero, zero, zero), down(zero, zero, -length), up(zero, zero, length), out(length, zero, zero);
        model.gravity.linear() = Vector(zero, zero, S(-9.81));
        pinocchio::JointIndex last = 0;
        if (ladder) {
            last = hinge(last, true, origin, 2, Vector(zero, zero, half), length);
            for (int k = 1; k <= size; ++k) {
                last = hinge(last, true, k == 1 ? up : origin, 0, Vector(half, zero, zero), length); /* rail */
                last = hinge(last, true, out, 2, Vector(zero, zero, -half), length);                 /* rung */
                hold(last, down);
            }
        } else {
            for (int k = 1; k <= size; ++k)
                last = hinge(last, k % 2 == 1, k == 1 ? origin : down, 2, Vector(zero, zero, -half), length);
            hold(last, down);
        }
        for (const auto &loop : loops) loop_data.emplace_back(loop);
    }

private:
    /* A rod along x (0) or z (2), centred at `middle`, on a hinge about y or x at `at` of the body before. */
    pinocchio::JointIndex hinge(pinocchio::JointIndex parent, bool about_y, const Vector &at, int along, const Vector &middle,
                                const S &length)
    {
        const Placement place(Placement::Matrix3::Identity(), at);
        const std::string name = "hinge" + std::to_string(model.njoints);
        const pinocchio::JointIndex joint = about_y
            ? model.addJoint(parent, pinocchio::JointModelRevoluteTpl<S, 0, 1>(), place, name)
            : model.addJoint(parent, pinocchio::JointModelRevoluteTpl<S, 0, 0>(), place, name);
        const S mass = length, r2(0.05 * 0.05), across = mass * (S(3) * r2 + length * length) / S(12);
        Eigen::Matrix<S, 3, 3> inertia = Eigen::Matrix<S, 3, 3>::Zero();
        for (int i = 0; i < 3; ++i) inertia(i, i) = i == along ? mass * r2 / S(2) : across;
        model.appendBodyToJoint(joint, pinocchio::InertiaTpl<S>(mass, middle, inertia), Placement::Identity());
        return joint;
    }

    void hold(pinocchio::JointIndex joint, const Vector &point)
    {
        const Placement place(Placement::Matrix3::Identity(), point);
        loops.emplace_back(pinocchio::CONTACT_3D, model, joint, place, pinocchio::LOCAL);
    }
};
