/*
 * Drive an exported governor by random twists, targets, jumps, reversals and garbage, and measure the joints that it
 * returns. Arguments: ticks, seed, dt, how often a slow tick is timed, whether levels are given, too; standard input:
 * start, velocity, acceleration, jerk, limits of position, margin.
 */
#include "arm.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

static unsigned long long state;

static double uniform(void)
{
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return (double)(state >> 11) / 9007199254740992.0;
}

static double any(void) { return 2.0 * uniform() - 1.0; }

static int one_of(int count) { return (int)(uniform() * count) % count; }

static const double slow = 1e-4; /* s: a tick that takes longer is timed again */

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

typedef struct {
    arm_pose target[ARM_FRAMES];
    double twist[6 * ARM_FRAMES];
    double leaf[ARM_R];
    int kind; /* 0 nothing, 1 target, 2 twist, 3 both; 4 more: a level */
} input;

static const double sizes[4] = {0.01, 0.1, 0.5, 3.0}, speeds[5] = {0.003, 0.05, 0.5, 5.0, 1000.0};
static const int holds[7] = {1, 1, 3, 20, 100, 400, 1500};

/* A new input: of what it was before, some are reversed. */
static void change(input *in, const arm_pose home[ARM_FRAMES])
{
    const int kind = one_of(12);
    const double size = sizes[one_of(4)], speed = speeds[one_of(5)];
    int i, f;
    if (kind == 0) {
        in->kind = 0;
        return;
    }
    if (kind == 1) { /* garbage */
        in->kind = 1 + one_of(3);
        for (i = 0; i < 9; i++) in->target[ARM_FRAMES - 1].R[i] = any() * 1e3;
        for (i = 0; i < 6 * ARM_FRAMES; i++) in->twist[i] = one_of(2) ? HUGE_VAL - HUGE_VAL : 1e300 * any();
        return;
    }
    if (kind == 2) {
        for (i = 0; i < 6 * ARM_FRAMES; i++) in->twist[i] = -in->twist[i];
        in->kind = 2;
        return;
    }
    if (kind < 7) {
        in->kind = 2;
        for (i = 0; i < 6 * ARM_FRAMES; i++) in->twist[i] = one_of(3) ? speed * any() : 0.0;
        return;
    }
    in->kind = 1;
    for (f = 0; f < ARM_FRAMES; f++) {
        in->target[f] = home[f];
        for (i = 0; i < 3; i++) in->target[f].p[i] += size * any();
        if (one_of(2)) { /* turned about z */
            const double c = cos(size * 2.0 * any()), s = sqrt(1.0 - c * c);
            for (i = 0; i < 3; i++) {
                in->target[f].R[i] = c * home[f].R[i] - s * home[f].R[3 + i];
                in->target[f].R[3 + i] = s * home[f].R[i] + c * home[f].R[3 + i];
            }
        }
    }
    if (kind == 11) in->target[ARM_FRAMES - 1].p[one_of(3)] = HUGE_VAL;
}

/* A new level, seldom garbage. */
static void change_level(input *in, const double leaf[ARM_R])
{
    const double size = sizes[one_of(4)];
    int i;
    for (i = 0; i < ARM_R; i++) in->leaf[i] = leaf[i] + size * any();
    if (one_of(20) == 0) in->leaf[one_of(ARM_R)] = one_of(2) ? HUGE_VAL - HUGE_VAL : 1e300 * any();
    in->kind |= 4;
}

/* Checksum of the bits of all joints. */
static unsigned long long checksum;

static void add_bits(const double q[ARM_N])
{
    int i;
    for (i = 0; i < ARM_N; i++) {
        unsigned long long bits;
        memcpy(&bits, &q[i], sizeof bits);
        checksum = (checksum ^ bits) * 1099511628211ULL;
    }
}

static double worst[3], nearest, leaves, apart, hand, level;
static long arrived, not_arrived, seen[6];

static void measure(const double q[ARM_N], double H[3][ARM_N], const arm_limits *limits, double dt,
                    const double lower[ARM_N], const double upper[ARM_N])
{
    int i, k;
    for (i = 0; i < ARM_N; i++) {
        const double d1 = q[i] - H[2][i], e1 = H[2][i] - H[1][i], f1 = H[1][i] - H[0][i];
        const double used[3] = {fabs(d1) / dt / limits->velocity[i],
                                fabs(d1 - e1) / (dt * dt) / limits->acceleration[i],
                                fabs(d1 - 2.0 * e1 + f1) / (dt * dt * dt) / limits->jerk[i]};
        for (k = 0; k < 3; k++)
            if (!(used[k] <= worst[k])) worst[k] = used[k];
        if (!(q[i] - lower[i] >= nearest)) nearest = q[i] - lower[i];
        if (!(upper[i] - q[i] >= nearest)) nearest = upper[i] - q[i];
        H[0][i] = H[1][i];
        H[1][i] = H[2][i];
        H[2][i] = q[i];
    }
}

static void measure_level(const double q[ARM_N], const double leaf[ARM_R], double *most)
{
    double c[ARM_R];
    int i;
    arm_leaf(q, c);
    for (i = 0; i < ARM_R; i++)
        if (!(fabs(c[i] - leaf[i]) <= *most)) *most = fabs(c[i] - leaf[i]);
}

/* Distance of the frames from where they rest; a pose also turns. */
static void measure_hand(const double q[ARM_N], const arm_pose home[ARM_FRAMES])
{
    arm_pose here[ARM_FRAMES];
    int f, i;
    arm_placement(q, here);
    for (f = 0; f < ARM_FRAMES; f++) {
        for (i = 0; i < 3; i++)
            if (!(fabs(here[f].p[i] - home[f].p[i]) <= hand)) hand = fabs(here[f].p[i] - home[f].p[i]);
        for (i = 0; i < 9 && ARM_M == 6 * ARM_FRAMES; i++)
            if (!(fabs(here[f].R[i] - home[f].R[i]) <= hand)) hand = fabs(here[f].R[i] - home[f].R[i]);
    }
}

static int ascending(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

int main(int count, char **argument)
{
    static arm_governor governor, copy;
    static double start[ARM_N], lower[ARM_N], upper[ARM_N];
    const long ticks = atol(argument[1]), repeats = atol(argument[4]);
    const double dt = atof(argument[3]);
    double *times = malloc(sizeof(double) * (size_t)ticks), H[3][ARM_N], q[ARM_N], leaf[ARM_R], sum = 0.0;
    arm_limits limits;
    arm_pose home[ARM_FRAMES];
    input in = {{{{0}, {0}}}, {0}, {0}, 0};
    const int levels = count > 5 && atoi(argument[5]);
    long k;
    int i, j, hold = 0, homing = 0, at_home = 0, alone = 0;
    double *rows[6];
    rows[0] = start;
    rows[1] = limits.velocity;
    rows[2] = limits.acceleration;
    rows[3] = limits.jerk;
    rows[4] = lower;
    rows[5] = upper;
    if (count < 5 || count > 6 || !times) return 1;
    for (j = 0; j < 6; j++)
        for (i = 0; i < ARM_N; i++)
            if (scanf("%lf", &rows[j][i]) != 1) return 2;
    if (scanf("%lf", &limits.margin) != 1) return 3;
    state = 88172645463325252ULL + 7919ULL * (unsigned long long)atol(argument[2]);
    if (arm_governor_start(&governor, start, dt, &limits) != ARM_OK) return 4;
    arm_placement(start, home);
    arm_leaf(start, leaf);
    nearest = HUGE_VAL;
    checksum = 14695981039346656037ULL;
    for (i = 0; i < ARM_N; i++) H[0][i] = H[1][i] = H[2][i] = start[i];
    for (k = 0; k < ticks; k++) {
        const arm_pose *target;
        const double *twist, *new_leaf;
        arm_status status;
        double took;
        if (hold-- == 0) {
            if (k % 7 == 0 && !homing) { /* home, and wait until it is there */
                homing = 1;
                hold = 20000;
                in.kind = levels ? 5 : 1;
                alone = at_home = 0;
                memcpy(in.target, home, sizeof home);
                memcpy(in.leaf, leaf, sizeof leaf);
            } else {
                if (homing) not_arrived++;
                homing = 0;
                hold = holds[one_of(7)];
                alone = levels && at_home && one_of(2);
                at_home = 0;
                if (alone)
                    in.kind = 0; /* the frames rest at home, and the level moves */
                else
                    change(&in, home);
                if (levels && (alone || one_of(2))) change_level(&in, leaf);
            }
        }
        target = in.kind & 1 ? in.target : NULL;
        twist = in.kind & 2 ? in.twist : NULL;
        new_leaf = in.kind & 4 ? in.leaf : NULL;
        copy = governor;
        took = now();
        status = arm_governor_step(&governor, target, twist, new_leaf, q);
        times[k] = now() - took;
        for (i = 1; i < repeats && times[k] > slow; i++) {
            arm_governor again = copy;
            double spare[ARM_N];
            took = now();
            arm_governor_step(&again, target, twist, new_leaf, spare);
            took = now() - took;
            if (took < times[k]) times[k] = took;
        }
        seen[status]++;
        add_bits(q);
        measure(q, H, &limits, dt, lower, upper);
        if (!levels) measure_level(q, leaf, &leaves);
        if (alone) measure_hand(q, home);
        if (status == ARM_OK && new_leaf && !twist) measure_level(q, new_leaf, &level);
        if (homing && status == ARM_OK) {
            for (i = 0; i < ARM_N; i++)
                if (!(fabs(q[i] - start[i]) <= apart)) apart = fabs(q[i] - start[i]);
            arrived++;
            homing = hold = 0;
            at_home = 1;
        }
    }
    for (k = 0; k < ticks; k++) sum += times[k];
    qsort(times, (size_t)ticks, sizeof(double), ascending);
    printf("%.12g %.12g %.12g %.12g %.3g %.3g %ld %ld %.4g %.4g %.4g %.4g", worst[0], worst[1], worst[2],
           nearest, leaves, apart, arrived, not_arrived, 1e6 * times[ticks / 2], 1e6 * sum / (double)ticks,
           1e6 * times[ticks - 1 - ticks / 1000], 1e6 * times[ticks - 1]);
    for (i = 0; i < 6; i++) printf(" %ld", seen[i]);
    printf(" %.3g %.3g", hand, level);
    printf(" %016llx\n", checksum);
    free(times);
    return 0;
}
