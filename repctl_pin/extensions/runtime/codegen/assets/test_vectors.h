/* Test vectors with Python's results, for check.c.
 *
 * @about */
#ifndef ARM_TEST_VECTORS_H
#define ARM_TEST_VECTORS_H

#include "arm.h"

#include <math.h>

#define ARM_VECTORS @count
#define ARM_VECTOR_TOLERANCE 1e-9

typedef struct {
    double q[ARM_N], xdot[ARM_M];
    arm_pose target[ARM_FRAMES];
    double dt;
    int has_twist;
    double twist[6 * ARM_FRAMES];
    int has_leaf;
    double leaf[ARM_R];
    arm_options options;
    double joint_speed[ARM_N], M[ARM_N * ARM_N], bias[ARM_N];
    arm_gains gains;
    int has_observer;
    double observer[ARM_R];
    arm_status usable, inside, velocity, step, torque; /* the status of placement, jacobian and leaf; of the others */
    arm_pose placement[ARM_FRAMES];
    double J[ARM_M * ARM_N], c[ARM_R], qdot[ARM_N], q_next[ARM_N], tau[ARM_N], observer_next[ARM_R];
} arm_vector;

static const arm_vector arm_vectors[ARM_VECTORS] = {
@vectors};
@functions
#endif
