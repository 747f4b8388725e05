
/* The inverse kinematic function of the cell; nullptr: leaf 0. */
inline Status F(const Pose& target, const Leaf* c, Joints& q) noexcept
{
    return static_cast<Status>(arm_F(&target, c ? c->data() : nullptr, q.data()));
}
