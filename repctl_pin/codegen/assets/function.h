
/*
 * q = F(x; c), the inverse kinematic function of the cell: the same pose gives the same joints, whatever came before.
 * leaf is c, how far the elbow is moved; NULL: 0. ARM_OUTSIDE: the target lies outside the cell, or its joints would
 * lie outside their ranges.
 */
arm_status arm_F(const arm_pose *target, const double *leaf, double q[ARM_N]);
