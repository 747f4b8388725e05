/* Minimum joint speed, with a posture in the null space. */

#ifndef REPCTL_LEAST_SPEED_H
#define REPCTL_LEAST_SPEED_H

/* qdot = z + J^+ (xdot - J z), z = gain (posture - q) or 0 without a posture; return 0, with qdot as it was, if J loses
   rank, by the test of pseudoinverse() in Python, or a number is not finite. */
int least_speed(const Arm *arm, const double q[], const double xdot[], const double *posture, double gain,
                double qdot[]);

/* J^+ (N, M) of J, whose rows become orthonormal; return 0 as above, and then G is not to be used. */
int inverse_of_rows(const Arm *arm, double J[][N], double G[]);

/* J^+ (N, M) at q; return 0 as above, and then G is not to be used. */
int least_inverse(const Arm *arm, const double q[], double G[]);

#endif
