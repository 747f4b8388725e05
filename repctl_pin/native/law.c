/* The control law of a repeatable inverse: potentials, J_V = [J; V^T], velocity, region and step. */

#include <math.h>
#include <stddef.h>

#include "chart.h"
#include "law.h"

/* ---- the potentials ---- */

/* Polynomials made homogeneous by z_0 = 1: w_i = dh/dz_i is a sum over monomials u, and h = sum w_i z_i / degree. */
static void add_polynomials(const Arm *arm, const Part *part, const double q[], double h[], double V[][N]) {
  const int k = part->k, width = (N - M) * (k + 1);
  double d[N], z[N], u[TERMS], w[WIDTH];
  (void)arm;
  for (int j = 0; j < k; j++) {
    d[j] = q[part->joint[j]] - part->center[j];
    z[j] = d[j] * part->scale[j];
  }
  u[0] = 1.0;
  for (int a = 1; a < part->count; a++) u[a] = u[part->parent[a]] * z[part->factor[a]];
  for (int j = 0; j < WIDTH; j++) w[j] = 0.0;
  for (int a = 0; a < part->count; a++)
    for (int j = 0; j < width; j++) w[j] += u[a] * part->weight[a * width + j];
  for (int i = 0; i < N - M; i++) {
    const double *slope = w + (k + 1) * i;
    double value = slope[0];
    for (int j = 0; j < k; j++) {
      value += slope[1 + j] * d[j];
      V[i][part->joint[j]] += slope[1 + j];
    }
    h[i] += value / part->degree;
  }
}

/* h = a^T sin(wave q) + b^T cos(wave q), a and b alternate in the weights. */
static void add_fourier_series(const Arm *arm, const Part *part, const double q[], double h[], double V[][N]) {
  (void)arm;
  for (int a = 0; a < part->count; a++) {
    const double *wave = part->wave + a * part->k, *weight = part->weight + a * 2 * (N - M);
    double phase = 0.0, s, c;
    for (int j = 0; j < part->k; j++) phase += wave[j] * q[part->joint[j]];
    s = sin(phase);
    c = cos(phase);
    for (int i = 0; i < N - M; i++) {
      const double slope = weight[2 * i] * c - weight[2 * i + 1] * s;
      h[i] += weight[2 * i] * s + weight[2 * i + 1] * c;
      for (int j = 0; j < part->k; j++) V[i][part->joint[j]] += wave[j] * slope;
    }
  }
}

/* h (N - M,) and V^T = dh/dq (N - M, N) at q, where the frame is at (p, R) with the Jacobian J. */
SHARED void potentials(const Arm *arm, const double q[], const double p[], const double R[], double J[][N],
                       double h[], double V[][N]) {
  for (int j = 0; j < N - M; j++) {
    h[j] = 0.0;
    for (int i = 0; i < N; i++) V[j][i] = 0.0;
  }
  for (int a = 0; a < arm->parts; a++) {
    const Part *part = arm->part + a;
    if (part->kind == POLYNOMIALS) add_polynomials(arm, part, q, h, V);
    if (part->kind == FOURIER_SERIES) add_fourier_series(arm, part, q, h, V);
#ifdef CHART
    if (part->kind == CELL) add_cell_potentials(arm, part->chart, q, p, R, J, h, V);
#endif
  }
  (void)p, (void)R, (void)J;
}

/* ---- the inverse ---- */

SHARED int find_leaf(const Arm *arm, const double q[], double c[]) {
  double p[3 * FRAMES], R[9 * FRAMES], J[M][N], h[N], V[N][N];
  if (!all_finite(q, N)) return BAD_NUMBER;
  place(arm, q, p, R, J);
  potentials(arm, q, p, R, J, h, V);
  if (!all_finite(h, N - M)) return BAD_NUMBER;
  for (int j = 0; j < N - M; j++) c[j] = h[j];
  return OK;
}

/* Factor J_V = [J; V^T] at q; return 0 if it is singular. */
static int augmented(const Arm *arm, const double q[], double A[][N], int swap[]) {
  double p[3 * FRAMES], R[9 * FRAMES], h[N];
  place(arm, q, p, R, A);
  potentials(arm, q, p, R, A, h, A + M);
  return regular(arm, A, swap);
}

SHARED int find_inverse(const Arm *arm, const double q[], double G[]) {
  double A[N][N], X[M][N];
  int swap[N];
  if (!all_finite(q, N)) return BAD_NUMBER;
  if (!augmented(arm, q, A, swap)) return SINGULAR;
  for (int a = 0; a < M; a++) {
    for (int i = 0; i < N; i++) X[a][i] = i == a;
    solve(arm, A, swap, X[a]);
    if (!all_finite(X[a], N)) return SINGULAR;
  }
  for (int a = 0; a < M; a++)
    for (int i = 0; i < N; i++) G[i * M + a] = X[a][i];
  return OK;
}

SHARED int find_velocity(const Arm *arm, const double q[], const double xdot[], double qdot[]) {
  double A[N][N], x[N];
  int swap[N];
  if (!all_finite(q, N) || !all_finite(xdot, M)) return BAD_NUMBER;
  for (int i = 0; i < N; i++) x[i] = i < M ? xdot[i] : 0.0;
  if (!augmented(arm, q, A, swap)) return SINGULAR;
  solve(arm, A, swap, x);
  if (!all_finite(x, N)) return SINGULAR;
  for (int i = 0; i < N; i++) qdot[i] = x[i];
  return OK;
}

/* ---- limits ---- */

/* Test whether q is in the region, to 1e-9 of its size. */
SHARED int find_inside(const Arm *arm, const double q[]) {
  const Region *region = arm->region;
  double p[3 * FRAMES], R[9 * FRAMES];
  if (!all_finite(q, N)) return BAD_NUMBER;
  if (!region) return OK;
#ifdef CHART
  if (region->chart) {
    place(arm, q, p, R, NULL);
    return in_cell(arm, region->chart, p, R) ? OK : OUTSIDE;
  }
#endif
  for (int a = 0; a < region->count; a++) {
    int i = 0;
    while (i < N && fabs(q[i] - region->center[a * N + i]) / region->half[i] <= 1.0 + 1e-9) i++;
    if (i == N) break;
    if (a == region->count - 1) return OUTSIDE;
  }
  if (region->axes) place(arm, q, p, R, NULL);
  for (int i = 0; i < region->axes; i++)
    if (!(fabs(p[region->axis[i]] - region->position[i]) / region->width[i] <= 1.0 + 1e-9)) return OUTSIDE;
  return OK;
}

/* Scale a step x = x_task + x_leaf to the joint speed limits, x_leaf first. */
static double shorten(const Arm *arm, double x[], const double x_task[], const double most[]) {
  double share = 1.0, whole = 1.0;
  (void)arm;
  for (int i = 0; i < N; i++) {
    const double back = x[i] - x_task[i], size = fabs(back);
    const double room = back > 0.0 ? most[i] - x_task[i] : most[i] + x_task[i];
    if (size > 1e-12 && room / size < share) share = room / size;
  }
  if (!(share > 0.0)) share = 0.0;
  for (int i = 0; i < N; i++) {
    const double shorter = x_task[i] + share * (x[i] - x_task[i]);
    const double size = fabs(shorter) > 1e-300 ? fabs(shorter) : 1e-300;
    if (most[i] / size < whole) whole = most[i] / size;
    x[i] = shorter;
  }
  for (int i = 0; i < N; i++) x[i] *= whole;
  return share < whole ? share : whole;
}

/* ---- the step ---- */

/* Compute q + J_V^-1 (dt [xdot; 0] + K dt [x - f(q); c - h(q)]); twist, leaf, options and report may be NULL. */
SHARED int take_step(const Arm *arm, const double q[], const Pose *target, double dt, const double *twist,
                     const double *leaf, const Options *options, Report *report, double q_next[]) {
  double A[N][N], V[N][N], s[N], p[3 * FRAMES], R[9 * FRAMES], h[N], b[N], x[N], most[N];
  double share = 1.0, damping = 0.0, slowed = 1.0;
  int swap[N], long_step = 0, stay_inside = 0;
  Factors factors;
  factors.A = A[0], factors.V = V[0], factors.s = s, factors.swap = swap;
  factors.by_values = 0;
  factors.square = 0.0;

  if (!(dt > 0.0 && dt < HUGE_VAL)) return BAD_NUMBER;
  for (int i = 0; i < N; i++) most[i] = HUGE_VAL;
  if (options) {
    stay_inside = options->stay_inside;
    damping = options->damping;
    if (!(damping >= 0.0 && damping < HUGE_VAL)) return BAD_NUMBER;
    for (int i = 0; i < N; i++) {
      most[i] = options->limit[i] * dt;
      if (!(most[i] > 0.0)) return BAD_NUMBER;
    }
    if (options->gain != WHOLE_STEP) share = options->gain * dt;
    if (!(share >= 0.0 && share <= 2.0)) return BAD_NUMBER;
  }
  if (!all_finite(q, N) || !usable(arm, target)) return BAD_NUMBER;
  if (stay_inside && find_inside(arm, q) != OK) return OUTSIDE;

  place(arm, q, p, R, A);
  potentials(arm, q, p, R, A, h, A + M);
  task_error(arm, p, R, target, b);
  for (int i = 0; i < M; i++) b[i] *= share;
  for (int i = 0; i < N - M; i++) b[M + i] = leaf ? share * (leaf[i] - h[i]) : 0.0;
  if (twist) add_rate(arm, R, twist, dt, b);
  if (!all_finite(b, N)) return BAD_NUMBER;

  if (damping > 0.0)
    damp(arm, &factors, damping);
  else if (!regular(arm, A, swap))
    return SINGULAR;
  apply_factors(arm, &factors, b, x);
  if (!all_finite(x, N)) return SINGULAR;

  for (int i = 0; i < N; i++)
    if (!(fabs(x[i]) <= most[i])) long_step = 1;
  if (long_step) {
    double x_task[N];
    for (int i = 0; i < N - M; i++) b[M + i] = 0.0;
    apply_factors(arm, &factors, b, x_task);
    slowed = shorten(arm, x, x_task, most);
  }
  for (int i = 0; i < N; i++) x[i] += q[i];
  if (stay_inside && !within_limits(arm, x)) return OUTSIDE;
  for (int i = 0; i < N; i++) q_next[i] = x[i];
  if (report) {
    report->damping = sqrt(factors.square);
    report->slowed = slowed;
  }
  return OK;
}
