/* Minimum joint speed, with a posture in the null space. */

#ifndef REPCTL_LEAST_SPEED_H
#define REPCTL_LEAST_SPEED_H

/* qdot = z + J^T (J J^T)^-1 (xdot - J z), z = gain (posture - q) or 0 without a posture; return 0, with qdot as it was,
   if J J^T, which squares the condition number of J, is not accurate enough. */
int least_speed(const Arm *arm, const double q[], const double xdot[], const double *posture, double gain,
                double qdot[]);

#endif
