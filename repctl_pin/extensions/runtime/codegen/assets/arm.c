/* @about */
#include "arm.h"

#include <math.h>
#include <stddef.h>

#if defined(__FAST_MATH__) || defined(_M_FP_FAST) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__)
#error "compile without -ffast-math, -ffinite-math-only and /fp:fast: the code tests whether numbers are finite"
#endif

/* ---- the arm ----------------------------------------------------------------------------------------------- */

static void arm_place(const double q[ARM_N], double p[3], double R[9])
{
@placement
}

static void arm_slope(const double q[ARM_N], double J[][ARM_N])
{
@jacobian
}

static void arm_chain(const double q[ARM_N], double p[3], double R[9], double J[][ARM_N])
{
@chain
}

/* ---- the task error ---------------------------------------------------------------------------------------- */

@error

/* ---- the potentials h and V^T = dh/dq ---------------------------------------------------------------------- */

@potentials

static void arm_potentials(const double q[ARM_N], double h[ARM_R], double V[][ARM_N])
{
    int i, j;
    for (j = 0; j < ARM_R; j++) {
        h[j] = 0.0;
        for (i = 0; i < ARM_N; i++) V[j][i] = 0.0;
    }
@parts
}

/* ---- numbers ----------------------------------------------------------------------------------------------- */

#define ARM_TOLERANCE 1e-6 /* minimum sine of the angle between a row of J_V and the span of the others */

static int arm_finite(const double *x, int count)
{
    int i;
    for (i = 0; i < count; i++)
        if (!(fabs(x[i]) < HUGE_VAL)) return 0;
    return 1;
}

/* Factor A = P L U in place, with 1 / U on the diagonal; return 0 if a pivot is 0 or not finite. */
static int arm_factor(double A[ARM_N][ARM_N], int swap[ARM_N])
{
    int i, j, k;
    for (k = 0; k < ARM_N; k++) {
        double size = fabs(A[k][k]), scale;
        int best = k;
        for (i = k + 1; i < ARM_N; i++)
            if (fabs(A[i][k]) > size) {
                size = fabs(A[i][k]);
                best = i;
            }
        if (!(size > 0.0)) return 0;
        swap[k] = best;
        if (best != k)
            for (j = 0; j < ARM_N; j++) {
                const double a = A[k][j];
                A[k][j] = A[best][j];
                A[best][j] = a;
            }
        scale = A[k][k] = 1.0 / A[k][k];
        for (i = k + 1; i < ARM_N; i++) {
            const double l = A[i][k] *= scale;
            for (j = k + 1; j < ARM_N; j++) A[i][j] -= l * A[k][j];
        }
    }
    return 1;
}

/* Solve x <- A^-1 x with the factors of A. */
static void arm_solve(double LU[ARM_N][ARM_N], const int swap[ARM_N], double x[ARM_N])
{
    int i, k;
    for (k = 0; k < ARM_N; k++) {
        const double a = x[swap[k]];
        x[swap[k]] = x[k];
        x[k] = a;
    }
    for (k = 0; k < ARM_N; k++)
        for (i = k + 1; i < ARM_N; i++) x[i] -= LU[i][k] * x[k];
    for (k = ARM_N - 1; k >= 0; k--) {
        x[k] *= LU[k][k];
        for (i = 0; i < k; i++) x[i] -= LU[i][k] * x[k];
    }
}

/*
 * Factor A; return 0 if A is singular: a row is close to the span of the others. The sine of their angle is
 * 1 / (|row i of A| |column i of A^-1|) >= |det A| / prod |row|; this bound is tested first.
 */
static int arm_regular(double A[ARM_N][ARM_N], int swap[ARM_N])
{
    double rows[ARM_N], all = 1.0, det = 1.0;
    int i, k;
    for (i = 0; i < ARM_N; i++) {
        rows[i] = 0.0;
        for (k = 0; k < ARM_N; k++) rows[i] += A[i][k] * A[i][k];
        all *= rows[i];
    }
    if (!arm_factor(A, swap)) return 0;
    for (i = 0; i < ARM_N; i++) det *= A[i][i]; /* 1 / det */
    if (all * det * det < 0.5 / (ARM_TOLERANCE * ARM_TOLERANCE) && all > 1e-200 && fabs(det) > 1e-100) return 1;
    for (i = 0; i < ARM_N; i++) {
        double column[ARM_N] = {0.0}, size = 0.0;
        column[i] = 1.0;
        arm_solve(A, swap, column);
        for (k = 0; k < ARM_N; k++) size += column[k] * column[k];
        if (!(rows[i] * size < 1.0 / (ARM_TOLERANCE * ARM_TOLERANCE))) return 0;
    }
    return 1;
}

/* Singular value decomposition A V = U S by one-sided Jacobi rotations: A becomes U S, V orthogonal. */
static void arm_svd(double A[ARM_N][ARM_N], double V[ARM_N][ARM_N])
{
    int sweep, i, j, k, turned = 1;
    for (i = 0; i < ARM_N; i++)
        for (j = 0; j < ARM_N; j++) V[i][j] = i == j ? 1.0 : 0.0;
    for (sweep = 0; sweep < 40 && turned; sweep++) {
        turned = 0;
        for (i = 0; i < ARM_N - 1; i++)
            for (j = i + 1; j < ARM_N; j++) {
                double a = 0.0, b = 0.0, g = 0.0, z, t, c, s;
                for (k = 0; k < ARM_N; k++) {
                    a += A[k][i] * A[k][i];
                    b += A[k][j] * A[k][j];
                    g += A[k][i] * A[k][j];
                }
                if (!(fabs(g) > 1e-16 * sqrt(a) * sqrt(b)) || !(a + b < HUGE_VAL)) continue;
                turned = 1;
                z = (b - a) / (2.0 * g);
                t = (z >= 0.0 ? 1.0 : -1.0) / (fabs(z) + sqrt(1.0 + z * z));
                c = 1.0 / sqrt(1.0 + t * t);
                s = c * t;
                for (k = 0; k < ARM_N; k++) {
                    const double left = A[k][i], right = A[k][j], first = V[k][i], second = V[k][j];
                    A[k][i] = c * left - s * right;
                    A[k][j] = s * left + c * right;
                    V[k][i] = c * first - s * second;
                    V[k][j] = s * first + c * second;
                }
            }
    }
}

/* Factors of J_V, for several right-hand sides. */
typedef struct {
    double A[ARM_N][ARM_N]; /* L and U, or U S */
    double V[ARM_N][ARM_N]; /* V of A V = U S */
    double s[ARM_N];        /* squares of the singular values */
    double square;          /* lambda squared, if s is used */
    int swap[ARM_N];
    int by_values; /* 1 if s is used */
} arm_factors;

/*
 * Damping near singularities: x = sum v_i s_i / (s_i^2 + lambda^2) u_i^T b, lambda^2 = most^2 (1 - (s_min / 2 most)^2)
 * if s_min < 2 most, else 0. Far from singularities the factors are L and U.
 */
static void arm_damp(arm_factors *factors, double most)
{
    double A[ARM_N][ARM_N], norm = 0.0, least = HUGE_VAL, ratio;
    int i, k;
    for (i = 0; i < ARM_N; i++)
        for (k = 0; k < ARM_N; k++) A[i][k] = factors->A[i][k];
    factors->by_values = 0;
    factors->square = 0.0;
    if (arm_factor(factors->A, factors->swap)) {
        for (k = 0; k < ARM_N; k++) {
            double column[ARM_N] = {0.0};
            column[k] = 1.0;
            arm_solve(factors->A, factors->swap, column);
            for (i = 0; i < ARM_N; i++) norm += column[i] * column[i];
        }
        if (sqrt(norm) < 1.0 / (2.0 * most)) return; /* s_min >= 1 / |A^-1|_F: far from singularities */
    }
    factors->by_values = 1;
    for (i = 0; i < ARM_N; i++)
        for (k = 0; k < ARM_N; k++) factors->A[i][k] = A[i][k];
    arm_svd(factors->A, factors->V);
    for (i = 0; i < ARM_N; i++) {
        factors->s[i] = 0.0;
        for (k = 0; k < ARM_N; k++) factors->s[i] += factors->A[k][i] * factors->A[k][i];
        if (!(factors->s[i] >= least)) least = factors->s[i];
    }
    ratio = sqrt(least) / (2.0 * most);
    if (ratio < 1.0) factors->square = most * most * (1.0 - ratio * ratio);
}

/* Compute x = J_V^-1 b, damped if arm_damp() found a singularity near. */
static void arm_apply(arm_factors *factors, const double b[ARM_N], double x[ARM_N])
{
    int i, k;
    if (!factors->by_values) {
        for (i = 0; i < ARM_N; i++) x[i] = b[i];
        arm_solve(factors->A, factors->swap, x);
        return;
    }
    for (i = 0; i < ARM_N; i++) x[i] = 0.0;
    for (i = 0; i < ARM_N; i++) {
        double share = 0.0;
        for (k = 0; k < ARM_N; k++) share += factors->A[k][i] * b[k];
        share /= factors->s[i] + factors->square;
        for (k = 0; k < ARM_N; k++) x[k] += factors->V[k][i] * share;
    }
}

/* ---- functions of the header ------------------------------------------------------------------------------- */

arm_status arm_placement(const double q[ARM_N], arm_pose *pose)
{
    arm_pose there;
    if (!arm_finite(q, ARM_N)) return ARM_BAD_NUMBER;
    arm_place(q, there.p, there.R);
    *pose = there;
    return ARM_OK;
}

arm_status arm_jacobian(const double q[ARM_N], double J[ARM_M * ARM_N])
{
    double rows[ARM_M][ARM_N];
    int a, i;
    if (!arm_finite(q, ARM_N)) return ARM_BAD_NUMBER;
    arm_slope(q, rows);
    for (a = 0; a < ARM_M; a++)
        for (i = 0; i < ARM_N; i++) J[a * ARM_N + i] = rows[a][i];
    return ARM_OK;
}

arm_status arm_leaf(const double q[ARM_N], double c[ARM_R])
{
    double h[ARM_R], V[ARM_R][ARM_N];
    int j;
    if (!arm_finite(q, ARM_N)) return ARM_BAD_NUMBER;
    arm_potentials(q, h, V);
    for (j = 0; j < ARM_R; j++) c[j] = h[j];
    return ARM_OK;
}

/* Factor J_V = [J; V^T] at q; return 0 if it is singular. */
static int arm_augmented(const double q[ARM_N], double A[ARM_N][ARM_N], int swap[ARM_N])
{
    double h[ARM_R];
    arm_slope(q, A);
    arm_potentials(q, h, A + ARM_M);
    return arm_regular(A, swap);
}

arm_status arm_inverse(const double q[ARM_N], double G[ARM_N * ARM_M])
{
    double A[ARM_N][ARM_N], X[ARM_M][ARM_N];
    int swap[ARM_N], a, i;
    if (!arm_finite(q, ARM_N)) return ARM_BAD_NUMBER;
    if (!arm_augmented(q, A, swap)) return ARM_SINGULAR;
    for (a = 0; a < ARM_M; a++) {
        for (i = 0; i < ARM_N; i++) X[a][i] = i == a ? 1.0 : 0.0;
        arm_solve(A, swap, X[a]);
        if (!arm_finite(X[a], ARM_N)) return ARM_SINGULAR;
    }
    for (a = 0; a < ARM_M; a++)
        for (i = 0; i < ARM_N; i++) G[i * ARM_M + a] = X[a][i];
    return ARM_OK;
}

arm_status arm_velocity(const double q[ARM_N], const double xdot[ARM_M], double qdot[ARM_N])
{
    double A[ARM_N][ARM_N], x[ARM_N];
    int swap[ARM_N], i;
    if (!arm_finite(q, ARM_N) || !arm_finite(xdot, ARM_M)) return ARM_BAD_NUMBER;
    for (i = 0; i < ARM_N; i++) x[i] = i < ARM_M ? xdot[i] : 0.0;
    if (!arm_augmented(q, A, swap)) return ARM_SINGULAR;
    arm_solve(A, swap, x);
    if (!arm_finite(x, ARM_N)) return ARM_SINGULAR;
    for (i = 0; i < ARM_N; i++) qdot[i] = x[i];
    return ARM_OK;
}

@inside

@limits

void arm_defaults(arm_options *options)
{
    int i;
    options->gain = ARM_WHOLE_STEP;
    options->damping = 0.0;
    options->stay_inside = @staying;
    for (i = 0; i < ARM_N; i++) options->limit[i] = HUGE_VAL;
}

/* Scale a step x = x_task + x_leaf to the joint speed limits, x_leaf first. */
static double arm_within(double x[ARM_N], const double x_task[ARM_N], const double most[ARM_N])
{
    double share = 1.0, whole = 1.0;
    int i;
    for (i = 0; i < ARM_N; i++) {
        const double back = x[i] - x_task[i], size = fabs(back);
        const double room = back > 0.0 ? most[i] - x_task[i] : most[i] + x_task[i];
        if (size > 1e-15 && room / size < share) share = room / size;
    }
    if (!(share > 0.0)) share = 0.0;
    for (i = 0; i < ARM_N; i++) {
        const double shorter = x_task[i] + share * (x[i] - x_task[i]);
        const double size = fabs(shorter) > 1e-300 ? fabs(shorter) : 1e-300;
        if (most[i] / size < whole) whole = most[i] / size;
        x[i] = shorter;
    }
    for (i = 0; i < ARM_N; i++) x[i] *= whole;
    return share < whole ? share : whole;
}

arm_status arm_step(const double q[ARM_N], const arm_pose *target, double dt, const double *twist,
                    const double *leaf, const arm_options *options, arm_report *report, double q_next[ARM_N])
{
    arm_factors factors;
    double p[3], R[9], h[ARM_R], b[ARM_N], x[ARM_N], most[ARM_N];
    double share = 1.0, damping = 0.0, slowed = 1.0;
    int i, long_step = 0, stay_inside = @staying;

    if (!(dt > 0.0 && dt < HUGE_VAL)) return ARM_BAD_NUMBER;
    for (i = 0; i < ARM_N; i++) most[i] = HUGE_VAL;
    if (options) {
        stay_inside = options->stay_inside;
        damping = options->damping;
        if (!(damping >= 0.0 && damping < HUGE_VAL)) return ARM_BAD_NUMBER;
        for (i = 0; i < ARM_N; i++) {
            most[i] = options->limit[i] * dt;
            if (!(most[i] > 0.0)) return ARM_BAD_NUMBER;
        }
        if (options->gain != ARM_WHOLE_STEP) share = options->gain * dt;
        if (!(share >= 0.0 && share <= 2.0)) return ARM_BAD_NUMBER;
    }
    if (!arm_finite(q, ARM_N) || !arm_rotation(target->R)) return ARM_BAD_NUMBER;
    if (stay_inside && arm_inside(q) != ARM_OK) return ARM_OUTSIDE;

    arm_chain(q, p, R, factors.A);
    arm_potentials(q, h, factors.A + ARM_M);
    arm_error(p, R, target, b);
    for (i = 0; i < ARM_M; i++) b[i] *= share;
    for (i = 0; i < ARM_R; i++) b[ARM_M + i] = leaf ? share * (leaf[i] - h[i]) : 0.0;
    if (twist) arm_add_rate(R, twist, dt, b);
    if (!arm_finite(b, ARM_N)) return ARM_BAD_NUMBER;

    factors.by_values = 0;
    factors.square = 0.0;
    if (damping > 0.0)
        arm_damp(&factors, damping);
    else if (!arm_regular(factors.A, factors.swap))
        return ARM_SINGULAR;
    arm_apply(&factors, b, x);
    if (!arm_finite(x, ARM_N)) return ARM_SINGULAR;

    for (i = 0; i < ARM_N; i++)
        if (!(fabs(x[i]) <= most[i])) long_step = 1;
    if (long_step) {
        double x_task[ARM_N];
        for (i = 0; i < ARM_R; i++) b[ARM_M + i] = 0.0;
        arm_apply(&factors, b, x_task);
        slowed = arm_within(x, x_task, most);
    }
    for (i = 0; i < ARM_N; i++) x[i] += q[i];
    if (stay_inside && !arm_within_limits(x)) return ARM_OUTSIDE;
    for (i = 0; i < ARM_N; i++) q_next[i] = x[i];
    if (report) {
        report->damping = sqrt(factors.square);
        report->slowed = slowed;
    }
    return ARM_OK;
}
@torque@function@governor
