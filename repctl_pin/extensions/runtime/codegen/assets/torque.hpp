
using Gains = arm_gains;
using Inertia = std::array<double, ARM_N * ARM_N>;

inline Gains torque_defaults() noexcept
{
    Gains gains;
    arm_torque_defaults(&gains);
    return gains;
}

/* Compute joint torques; nullptr: no twist, default gains, no observer. */
inline Status torque(const Joints& q, const Joints& qdot, const Inertia& M, const Joints& bias, const Poses& target,
                     const Twist* twist, const Leaf& c, const Gains* gains, double dt, Leaf* observer,
                     Joints& tau) noexcept
{
    return static_cast<Status>(arm_torque(q.data(), qdot.data(), M.data(), bias.data(), first(target),
                                          twist ? twist->data() : nullptr, c.data(), gains, dt,
                                          observer ? observer->data() : nullptr, tau.data()));
}
