/* @about */
#include "arm.h"

#include <math.h>
#include <stddef.h>

#if defined(__FAST_MATH__) || defined(_M_FP_FAST) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__)
#error "compile without -ffast-math, -ffinite-math-only and /fp:fast: the code tests whether numbers are finite"
#endif

/* ---- the sizes, types and statuses of the code below, which is that of repctl_pin's own library --------------- */

#define EXPORTED
#define SHARED static
#define N ARM_N
#define M ARM_M
#define FRAMES ARM_FRAMES
#define ROWS @rows
#define JOINTS @joints
#define MOST_JOINTS @most
#define MOST_N ARM_N
#define MOST_FRAMES ARM_FRAMES
#define TERMS @terms
#define WIDTH (ARM_R * (ARM_N + 1))
#define OK ARM_OK
#define SINGULAR ARM_SINGULAR
#define BAD_NUMBER ARM_BAD_NUMBER
#define OUTSIDE ARM_OUTSIDE
#define SLOWED ARM_SLOWED
#define LIMIT ARM_LIMIT
#define RECOVERING ARM_RECOVERING
typedef arm_pose Pose;
typedef arm_options Options;
typedef arm_report Report;

@declared

/* ---- the arm ------------------------------------------------------------------------------------------------- */

@tables
@library
/* ---- functions of the header --------------------------------------------------------------------------------- */

arm_status arm_placement(const double q[ARM_N], arm_pose pose[ARM_FRAMES])
{
    if (!all_finite(q, N)) return ARM_BAD_NUMBER;
    find_poses(arm_tables, q, pose);
    return ARM_OK;
}

arm_status arm_jacobian(const double q[ARM_N], double J[ARM_M * ARM_N])
{
    double p[3 * FRAMES], R[9 * FRAMES], rows[M][N];
    int a, i;
    if (!all_finite(q, N)) return ARM_BAD_NUMBER;
    place(arm_tables, q, p, R, rows);
    for (a = 0; a < M; a++)
        for (i = 0; i < N; i++) J[a * N + i] = rows[a][i];
    return ARM_OK;
}

arm_status arm_inverse(const double q[ARM_N], double G[ARM_N * ARM_M])
{
    return (arm_status)find_inverse(arm_tables, q, G);
}

arm_status arm_leaf(const double q[ARM_N], double c[ARM_R])
{
    return (arm_status)find_leaf(arm_tables, q, c);
}

arm_status arm_velocity(const double q[ARM_N], const double xdot[ARM_M], double qdot[ARM_N])
{
    return (arm_status)find_velocity(arm_tables, q, xdot, qdot);
}

arm_status arm_inside(const double q[ARM_N])
{
    return (arm_status)find_inside(arm_tables, q);
}

void arm_defaults(arm_options *options)
{
    int i;
    options->gain = WHOLE_STEP;
    options->damping = 0.0;
    options->stay_inside = @staying;
    for (i = 0; i < N; i++) options->limit[i] = HUGE_VAL;
}

arm_status arm_step(const double q[ARM_N], const arm_pose *target, double dt, const double *twist,
                    const double *leaf, const arm_options *options, arm_report *report, double q_next[ARM_N])
{
    arm_options usual;
    if (!options) arm_defaults(&usual);
    return (arm_status)take_step(arm_tables, q, target, dt, twist, leaf, options ? options : &usual, report, q_next);
}
@torque@function@governor@closing
