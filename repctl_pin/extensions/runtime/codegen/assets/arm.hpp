/* @about */
#ifndef ARM_HPP
#define ARM_HPP

#include "arm.h"

#include <array>
#include <cstddef>
#include <type_traits>

/* The functions of arm.h for std::array, with [[nodiscard]] status. Requires C++17. */
namespace arm {

inline constexpr std::size_t joints = ARM_N, coordinates = ARM_M, potentials = ARM_R;
inline constexpr const char* joint_names[ARM_N] = @names;
inline constexpr const char* frame = @frame;

using Joints = std::array<double, ARM_N>;
using Rates = std::array<double, ARM_M>;
using Leaf = std::array<double, ARM_R>;
using Twist = std::array<double, 6 * ARM_FRAMES>;
using Pose = arm_pose;
using Poses = std::conditional_t<ARM_FRAMES == 1, Pose, std::array<Pose, ARM_FRAMES>>; /* of all frames */
using Options = arm_options;
using Report = arm_report;

enum class [[nodiscard]] Status {
    ok = ARM_OK,
    singular = ARM_SINGULAR,
    bad_number = ARM_BAD_NUMBER,
    outside = ARM_OUTSIDE,
    slowed = ARM_SLOWED,
    limit = ARM_LIMIT,
    recovering = ARM_RECOVERING
};

inline Options defaults() noexcept
{
    Options options;
    arm_defaults(&options);
    return options;
}

/* Find the pose of the first frame. */
template <typename Any>
auto* first(Any& poses) noexcept
{
    if constexpr (std::is_same_v<std::remove_const_t<Any>, Pose>)
        return &poses;
    else
        return poses.data();
}

/* Convert a homogeneous matrix, column by column, such as libfranka's O_T_EE. */
inline Pose from_columns(const std::array<double, 16>& T) noexcept
{
    return {{T[12], T[13], T[14]}, {T[0], T[4], T[8], T[1], T[5], T[9], T[2], T[6], T[10]}};
}

inline Status placement(const Joints& q, Poses& poses) noexcept
{
    return static_cast<Status>(arm_placement(q.data(), first(poses)));
}

/* J (m, n), row by row. */
inline Status jacobian(const Joints& q, std::array<double, ARM_M * ARM_N>& J) noexcept
{
    return static_cast<Status>(arm_jacobian(q.data(), J.data()));
}

/* G (n, m), row by row. */
inline Status inverse(const Joints& q, std::array<double, ARM_N * ARM_M>& G) noexcept
{
    return static_cast<Status>(arm_inverse(q.data(), G.data()));
}

inline Status leaf(const Joints& q, Leaf& c) noexcept
{
    return static_cast<Status>(arm_leaf(q.data(), c.data()));
}

inline Status velocity(const Joints& q, const Rates& xdot, Joints& qdot) noexcept
{
    return static_cast<Status>(arm_velocity(q.data(), xdot.data(), qdot.data()));
}

inline Status inside(const Joints& q) noexcept
{
    return static_cast<Status>(arm_inside(q.data()));
}

/* Compute the next q of a control loop; nullptr: no twist, no leaf, default options, no report. */
inline Status step(const Joints& q, const Poses& target, double dt, const Twist* twist, const Leaf* c,
                   const Options* options, Report* report, Joints& q_next) noexcept
{
    return static_cast<Status>(arm_step(q.data(), first(target), dt, twist ? twist->data() : nullptr,
                                        c ? c->data() : nullptr, options, report, q_next.data()));
}
@torque@function@governor@closing
}  // namespace arm

#endif
