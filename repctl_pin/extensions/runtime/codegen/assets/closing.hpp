
/* Test whether a pose is within the proved closing radius. */
inline Status within_closing_radius(const Pose& pose) noexcept
{
    return static_cast<Status>(arm_within_closing_radius(&pose));
}
