/* Hostile and random numbers into every function of arm.h: outputs stay untouched unless it says ARM_OK, and are
 * finite where it does; velocity obeys its law. Built with sanitizers, which watch the rest. */
#include "arm.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static unsigned long long state = 88172645463325252ULL;

static double uniform(void)
{
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return (double)(state >> 11) / 9007199254740992.0;
}

static double hostile(void)
{
    static const double odd[] = {0.0, -0.0, 1e308, -1e308, 5e-324, -5e-324, 1e-310, 1e16, -1e9, 3.141592653589793};
    const double u = uniform();
    if (u < 0.01) return HUGE_VAL;
    if (u < 0.02) return -HUGE_VAL;
    if (u < 0.03) return HUGE_VAL - HUGE_VAL;
    if (u < 0.08) return odd[(int)(10.0 * uniform()) % 10];
    return 6.0 * uniform() - 3.0;
}

static double *some(double *x, int count, int calm)
{
    int i;
    for (i = 0; i < count; i++) x[i] = calm ? 2.0 * uniform() - 1.0 : hostile();
    return x;
}

static int finite_all(const double *x, int count)
{
    int i;
    for (i = 0; i < count; i++)
        if (!(fabs(x[i]) < HUGE_VAL)) return 0;
    return 1;
}

static void must(int so, const char *what, long k)
{
    if (so) return;
    printf("input %ld: %s\n", k, what);
    exit(1);
}

/* A rotation, from two vectors at random. */
static void turn(double R[9])
{
    double length = 0.0, along = 0.0;
    int i;
    some(R, 6, 1);
    for (i = 0; i < 3; i++) length += R[i] * R[i];
    for (i = 0; i < 3; i++) R[i] /= sqrt(length);
    for (i = 0; i < 3; i++) along += R[i] * R[3 + i];
    for (i = 0; i < 3; i++) R[3 + i] -= along * R[i];
    length = R[3] * R[3] + R[4] * R[4] + R[5] * R[5];
    for (i = 3; i < 6; i++) R[i] /= sqrt(length);
    R[6] = R[1] * R[5] - R[2] * R[4];
    R[7] = R[2] * R[3] - R[0] * R[5];
    R[8] = R[0] * R[4] - R[1] * R[3];
}

#define MARK 12345.678

static int marked(const double *x, int count)
{
    int i;
    for (i = 0; i < count; i++)
        if (memcmp(&x[i], &(double){MARK}, sizeof(double)) != 0) return 0;
    return 1;
}

static void mark(double *x, int count)
{
    int i;
    for (i = 0; i < count; i++) x[i] = MARK;
}

int main(int argc, char **argv)
{
    const long count = argc > 1 ? atol(argv[1]) : 1000;
    long k, torques = 0, seen[4] = {0, 0, 0, 0};
    for (k = 0; k < count; k++) {
        const int calm = uniform() < 0.5;
        double q[ARM_N], xdot[ARM_M], twist[6 * ARM_FRAMES], leaf[ARM_R], J[ARM_M * ARM_N], G[ARM_N * ARM_M], c[ARM_R], out[ARM_N];
        arm_pose target[ARM_FRAMES], pose[ARM_FRAMES];
        arm_options options;
        arm_report report;
        arm_status status;
        int f, i;
        some(q, ARM_N, calm);
        if (uniform() < 0.05) memset(q, 0, sizeof q);
        some(xdot, ARM_M, calm), some(twist, 6 * ARM_FRAMES, calm), some(leaf, ARM_R, calm);
        for (f = 0; f < ARM_FRAMES; f++) {
            some(target[f].p, 3, calm), some(target[f].R, 9, 0);
            if (uniform() < 0.9) turn(target[f].R);
        }

        for (f = 0; f < ARM_FRAMES; f++) mark(pose[f].p, 3), mark(pose[f].R, 9);
        mark(J, ARM_M * ARM_N), mark(c, ARM_R), mark(G, ARM_N * ARM_M);
        status = arm_placement(q, pose);
        for (f = 0; f < ARM_FRAMES; f++)
            must(status == ARM_OK ? finite_all(q, ARM_N) : marked(pose[f].p, 3) && marked(pose[f].R, 9), "placement", k);
        status = arm_jacobian(q, J);
        must(status == ARM_OK ? finite_all(q, ARM_N) : marked(J, ARM_M * ARM_N), "jacobian", k);
        status = arm_leaf(q, c);
        must(status == ARM_OK ? finite_all(q, ARM_N) : marked(c, ARM_R), "leaf", k);
        status = arm_inverse(q, G);
        must(status == ARM_OK ? finite_all(G, ARM_N * ARM_M) : marked(G, ARM_N * ARM_M), "inverse", k);
        arm_inside(q);

        mark(out, ARM_N);
        status = arm_velocity(q, xdot, out);
        must(status == ARM_OK ? finite_all(out, ARM_N) : marked(out, ARM_N), "velocity", k);
        if (status == ARM_OK && calm) {
            int a;
            double size = 1.0;
            for (i = 0; i < ARM_N; i++) size += fabs(out[i]);
            for (a = 0; a < ARM_M; a++) {
                double away = -xdot[a];
                for (i = 0; i < ARM_N; i++) away += J[a * ARM_N + i] * out[i];
                must(fabs(away) < 1e-12 * size, "J qdot = xdot", k);
            }
        }

        arm_defaults(&options);
        if (uniform() < 0.5) options.damping = calm ? 0.1 : hostile();
        if (uniform() < 0.5) options.gain = calm ? 10.0 : hostile();
        if (uniform() < 0.5)
            for (i = 0; i < ARM_N; i++) options.limit[i] = calm ? 0.5 : hostile();
        options.stay_inside = uniform() < 0.3;
        mark(out, ARM_N);
        report.damping = report.slowed = MARK;
        status = arm_step(q, target, calm ? 0.01 : hostile(), uniform() < 0.5 ? twist : NULL,
                          uniform() < 0.5 ? leaf : NULL, uniform() < 0.8 ? &options : NULL, &report, out);
        must(status == ARM_OK || (marked(out, ARM_N) && marked(&report.damping, 1)), "step", k);
        must(status != ARM_OK || (finite_all(q, ARM_N) && report.slowed <= 1.0), "step's report", k);
        seen[status]++;

        {
            double qdot[ARM_N], M[ARM_N * ARM_N], bias[ARM_N], observer[ARM_R], kept[ARM_R], tau[ARM_N];
            const int inert = uniform() < 0.9, observed = uniform() < 0.5;
            arm_gains gains;
            int a;
            some(qdot, ARM_N, calm), some(M, ARM_N * ARM_N, calm), some(bias, ARM_N, calm);
            some(observer, ARM_R, calm);
            if (inert) /* symmetric and, where calm, positive definite */
                for (i = 0; i < ARM_N; i++) {
                    for (a = 0; a < i; a++) M[a * ARM_N + i] = M[i * ARM_N + a];
                    M[i * ARM_N + i] += ARM_N + 1.0;
                }
            arm_torque_defaults(&gains);
            if (uniform() < 0.3) some(gains.stiffness, ARM_M, 0), gains.leaf_frequency = hostile();
            if (uniform() < 0.3) some(gains.observer_limit, ARM_N, 0), gains.observer_rate = hostile();
            mark(tau, ARM_N);
            memcpy(kept, observer, sizeof kept);
            status = arm_torque(q, qdot, M, bias, target, uniform() < 0.5 ? twist : NULL, leaf,
                                uniform() < 0.8 ? &gains : NULL, calm ? 0.001 : hostile(), observed ? observer : NULL,
                                tau);
            must(status == ARM_OK ? finite_all(tau, ARM_N) && (!observed || finite_all(observer, ARM_R))
                                  : marked(tau, ARM_N) && memcmp(kept, observer, sizeof kept) == 0, "torque", k);
            torques += status == ARM_OK;
        }
    }
    printf("%ld steps: %ld ok, %ld singular, %ld bad numbers, %ld outside\n", count, seen[0], seen[1], seen[2], seen[3]);
    must(seen[0] > 0 && seen[2] > 0 && torques > count / 10, "a kind of answer that never came", 0);
    return 0;
}
