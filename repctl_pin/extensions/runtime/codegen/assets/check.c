/*
 * Compare this build with Python's results: run it once on the robot's control computer.
 *
 *     cc -O2 arm.c check.c -o check -lm && ./check
 */
#include "arm.h"
#include "test_vectors.h"

#include <math.h>
#include <stdio.h>

static double worst = 0.0;
static int failures = 0;

static void compare(const char *what, int vector, const double *found, const double *wanted, int count)
{
    double size = 1.0;
    int i;
    for (i = 0; i < count; i++)
        if (fabs(wanted[i]) > size) size = fabs(wanted[i]);
    for (i = 0; i < count; i++) {
        const double away = fabs(found[i] - wanted[i]) / size;
        if (away > worst) worst = away;
        if (!(away <= ARM_VECTOR_TOLERANCE)) {
            printf("vector %d: %s[%d] is %.17g, not %.17g\n", vector, what, i, found[i], wanted[i]);
            failures++;
            return;
        }
    }
}

static int same(const char *what, int vector, arm_status found, arm_status wanted)
{
    if (found != wanted) {
        printf("vector %d: %s returned %d, not %d\n", vector, what, (int)found, (int)wanted);
        failures++;
    }
    return found == wanted && wanted == ARM_OK;
}

int main(void)
{
    int k;
    for (k = 0; k < ARM_VECTORS; k++) {
        const arm_vector *v = &arm_vectors[k];
        arm_pose pose[ARM_FRAMES];
        arm_options options = v->options;
        double J[ARM_M * ARM_N], c[ARM_R], qdot[ARM_N], q_next[ARM_N], tau[ARM_N], observer[ARM_R];
        int i;
        if (same("placement", k, arm_placement(v->q, pose), v->usable))
            for (i = 0; i < ARM_FRAMES; i++) {
                compare("p", k, pose[i].p, v->placement[i].p, 3);
                compare("R", k, pose[i].R, v->placement[i].R, 9);
            }
        if (same("jacobian", k, arm_jacobian(v->q, J), v->usable)) compare("J", k, J, v->J, ARM_M * ARM_N);
        if (same("leaf", k, arm_leaf(v->q, c), v->usable)) compare("c", k, c, v->c, ARM_R);
        same("inside", k, arm_inside(v->q), v->inside);
        if (same("velocity", k, arm_velocity(v->q, v->xdot, qdot), v->velocity))
            compare("qdot", k, qdot, v->qdot, ARM_N);
        if (same("step", k,
                 arm_step(v->q, v->target, v->dt, v->has_twist ? v->twist : NULL, v->has_leaf ? v->leaf : NULL,
                          &options, NULL, q_next),
                 v->step))
            compare("q_next", k, q_next, v->q_next, ARM_N);
        for (i = 0; i < ARM_R; i++) observer[i] = v->observer[i];
        if (same("torque", k,
                 arm_torque(v->q, v->joint_speed, v->M, v->bias, v->target, v->has_twist ? v->twist : NULL, v->leaf,
                            &v->gains, v->dt, v->has_observer ? observer : NULL, tau),
                 v->torque)) {
            compare("tau", k, tau, v->tau, ARM_N);
            compare("observer", k, observer, v->observer_next, ARM_R);
        }
    }
#ifdef ARM_FUNCTION_VECTORS
    for (k = 0; k < ARM_FUNCTION_VECTORS; k++) {
        const arm_function_vector *v = &arm_function_vectors[k];
        double q[ARM_N];
        if (same("F", k, arm_F(&v->target, v->leaf, q), v->status)) compare("q", k, q, v->q, ARM_N);
    }
#endif
    printf("%d vectors, %d differences, maximum %.2g\n", ARM_VECTORS, failures, worst);
    return failures ? 1 : 0;
}
