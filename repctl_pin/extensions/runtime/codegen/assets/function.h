
/*
 * q = F(x; c), the inverse kinematic function of the cell: one configuration per pose, independent of the
 * motion history. leaf is c, the displacement along the self-motion; NULL: 0. ARM_OUTSIDE: the target is outside the
 * cell, or q would be outside the joint limits.
 */
arm_status arm_F(const arm_pose *target, const double *leaf, double q[ARM_N]);

/* Compute q at many targets on one leaf, row by row; return the number of targets before the first failure. */
long arm_F_batch(long count, const arm_pose *targets, const double *leaf, double *q);
