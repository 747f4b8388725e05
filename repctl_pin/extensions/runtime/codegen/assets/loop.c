/*
 * Simulate ten circles at 1 kHz with exact joint tracking; comments mark the places to connect a robot.
 *
 *     cc -O2 arm.c loop.c -o loop -lm && ./loop
 */
#include "arm.h"

#include <math.h>
#include <stdio.h>

int main(void)
{
    const double start[ARM_N] = @start;
    const double along[2][3] = {
@along};
    const double turn = 6.283185307179586, radii[2] = @radii, dt = 1e-3, period = 5.0;
    const int steps = 50000;
    double q[ARM_N], leaf[ARM_R], twist[6 * ARM_FRAMES] = {0.0}, drift = 0.0;
    arm_pose target[ARM_FRAMES], begin[ARM_FRAMES];
    arm_options options;
    int f, i, k;

    for (i = 0; i < ARM_N; i++) q[i] = start[i]; /* read the joints here */
    arm_defaults(&options);
    options.gain = 20.0; /* 1/s: errors of the task and of the leaf decay within 0.2 s */
    if (arm_leaf(q, leaf) != ARM_OK || arm_placement(q, begin) != ARM_OK) return 1;

    for (k = 0; k < steps; k++) { /* libfranka: the body of robot.control()'s callback, dt = period.toSec() */
        const double angle = turn * k * dt / period, rate = turn / period;
        arm_status status;
        for (f = 0; f < ARM_FRAMES; f++) target[f] = begin[f]; /* the first frame moves */
        for (i = 0; i < 3; i++) {
            const double first = radii[0] * along[0][i], second = radii[1] * along[1][i];
            target[0].p[i] += first * (cos(angle) - 1.0) + second * sin(angle);
            twist[i] = rate * (second * cos(angle) - first * sin(angle));
        }
        status = arm_step(q, target, dt, twist, leaf, &options, NULL, q);
        if (status != ARM_OK) return printf("step %d: status %d; stop the arm\n", k, (int)status), 2;
        /* send q here: return franka::JointPositions({q[0], q[1], ...}); */
    }
    for (i = 0; i < ARM_N; i++) drift = fmax(drift, fabs(q[i] - start[i]));
    printf("maximum joint drift after ten circles: %.2g rad or m\n", drift);
    return 0;
}
