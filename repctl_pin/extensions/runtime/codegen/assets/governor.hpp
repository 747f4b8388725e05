
using Limits = arm_limits;
using Governor = arm_governor;

/* The speed limits of the URDF; set the accelerations. */
inline Limits governor_limits() noexcept
{
    Limits limits;
    arm_governor_limits(&limits);
    return limits;
}

/* Begin at rest at q; if it is refused, governor_step() leaves q_next as it is. */
inline Status governor_start(Governor& governor, const Joints& q, double dt, const Limits& limits) noexcept
{
    return static_cast<Status>(arm_governor_start(&governor, q.data(), dt, &limits));
}

/* Compute the next joints to command; nullptr: no target, no twist. Without both it stops. */
inline Status governor_step(Governor& governor, const Poses* target, const Twist* twist, Joints& q_next) noexcept
{
    return static_cast<Status>(arm_governor_step(&governor, target ? first(*target) : nullptr,
                                                 twist ? twist->data() : nullptr, q_next.data()));
}
