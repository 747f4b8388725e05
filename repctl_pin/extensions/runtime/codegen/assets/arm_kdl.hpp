/* @about */
#ifndef ARM_KDL_HPP
#define ARM_KDL_HPP

#if !__has_include(<kdl/chainiksolver.hpp>)
#error "arm_kdl.hpp requires Orocos KDL (Debian: liborocos-kdl-dev) and Eigen's include path"
#endif

#include "arm.hpp"

#include <cmath>
#include <kdl/chain.hpp>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <kdl/chainiksolver.hpp>
#include <stdexcept>
#include <string>

/* The functions of arm.h as solvers of Orocos KDL. Requires C++17; link with orocos-kdl. */
namespace arm {

/* Convert between KDL's types and those of arm.hpp. */
inline Pose from_kdl(const KDL::Frame& x) noexcept
{
    Pose pose = {{x.p.x(), x.p.y(), x.p.z()}, {}};
    for (int i = 0; i < 9; ++i)
        pose.R[i] = x.M.data[i];
    return pose;
}

inline Joints from_kdl(const KDL::JntArray& q)
{
    Joints joints{};
    for (unsigned i = 0; i < joints.size(); ++i)
        joints[i] = q(i);
    return joints;
}

inline void to_kdl(const Joints& joints, KDL::JntArray& q)
{
    q.resize(ARM_N);
    for (unsigned i = 0; i < joints.size(); ++i)
        q(i) = joints[i];
}

inline int to_kdl(Status status) noexcept
{
    switch (status) {
    case Status::ok:
        return KDL::SolverI::E_NOERROR;
    case Status::singular:
        return KDL::SolverI::E_NO_CONVERGE;
    case Status::outside:
        return KDL::SolverI::E_OUT_OF_RANGE;
    default:
        return KDL::SolverI::E_UNDEFINED;
    }
}

/*
 * Compare a chain with this arm: number, names and order of the joints, and the placement of its tip in several
 * configurations, to 1e-6 m. Throws std::invalid_argument that says what differs.
 */
inline void require_chain(const KDL::Chain& chain)
{
    if (chain.getNrOfJoints() != ARM_N)
        throw std::invalid_argument("this control has " + std::to_string(ARM_N) + " joints; the chain has " +
                                    std::to_string(chain.getNrOfJoints()));
    unsigned joint = 0;
    for (const KDL::Segment& segment : chain.segments) {
        const std::string name = segment.getJoint().getName();
        if (segment.getJoint().getType() == KDL::Joint::None)
            continue;
        if (name != joint_names[joint])
            throw std::invalid_argument("joint " + std::to_string(joint) + " of this control is " +
                                        joint_names[joint] + "; the chain's is " + name);
        ++joint;
    }
    KDL::ChainFkSolverPos_recursive forward(chain);
    for (unsigned moved = 0; moved <= ARM_N; ++moved) {
        Joints q = @start;
        if (moved < ARM_N)
            q[moved] += 0.3;
        Pose expected{};
        KDL::JntArray joints;
        KDL::Frame found;
        to_kdl(q, joints);
        if (placement(q, expected) != Status::ok || forward.JntToCart(joints, found) < 0)
            throw std::invalid_argument("the chain's forward kinematics failed");
        const Pose tip = from_kdl(found);
        double off = 0;
        for (int i = 0; i < 3; ++i)
            off = std::fmax(off, std::fabs(tip.p[i] - expected.p[i]));
        for (int i = 0; i < 9; ++i)
            off = std::fmax(off, std::fabs(tip.R[i] - expected.R[i]));
        if (!(off < 1e-6))
            throw std::invalid_argument("the chain's tip is not the frame of this control, or its base another: they "
                                        "are " + std::to_string(off) + " m or rad apart");
    }
}

/* qdot = G xdot: any closed path of the tip is a closed path of the joints. */
class ChainIkSolverVel : public KDL::ChainIkSolverVel {
public:
    explicit ChainIkSolverVel(const KDL::Chain& chain) : chain_(chain) { require_chain(chain); }

    int CartToJnt(const KDL::JntArray& q_in, const KDL::Twist& v_in, KDL::JntArray& qdot_out) override
    {
        if (q_in.rows() != ARM_N || qdot_out.rows() != ARM_N)
            return error = E_SIZE_MISMATCH;
        const Joints q = from_kdl(q_in);
        Rates xdot{};
        Joints qdot{};
@rates
        const Status status = velocity(q, xdot, qdot);
        if (status == Status::ok)
            to_kdl(qdot, qdot_out);
        return error = to_kdl(status);
    }

    int CartToJnt(const KDL::JntArray&, const KDL::FrameVel&, KDL::JntArrayVel&) override
    {
        return error = E_NOT_IMPLEMENTED;
    }

    void updateInternalDataStructures() override { require_chain(chain_); }

private:
    const KDL::Chain& chain_;
};

@solver

}  // namespace arm

#endif
