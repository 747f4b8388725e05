/* Joint torques of a spring and damper at the end effector, and of the return to the leaf. */

#ifndef REPCTL_TORQUE_H
#define REPCTL_TORQUE_H

#include "arm.h"

#ifndef EXPORTED
#define MOST_M MOST_N

/* Gains of the torque law. */
typedef struct {
  double stiffness[MOST_M];      /* K of the end effector, one per row of J, N/m and Nm/rad, above 0 */
  double damping;                /* damping ratio of the end effector; 1 is critical */
  double leaf_frequency;         /* natural frequency of the return to the leaf, rad/s */
  double leaf_damping;           /* damping ratio of the return to the leaf */
  double observer_rate;          /* rate at which the observer follows a disturbance of the leaf, 1/s */
  double observer_limit[MOST_N]; /* maximum torque of the observer in each joint, Nm or N, above 0 */
} Gains;
#endif

SHARED int joint_torques(const Arm *arm, const double q[], const double qdot[], const double inertia[],
                       const double bias[], const Pose *target, const double *twist, const double leaf[],
                       const Gains *gains, double dt, double *observer, double tau[]);

#endif
