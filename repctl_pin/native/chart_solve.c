/* Newton's method on f(q) = x, n_ref^T (q - q_ref) = s, at many poses.

   The same mathematics as kinematics.py and chart.py, one pose at a time. */

#include <math.h>

#include "arm.h"
#include "chain.h"

enum { MOST = 32 }; /* joints of a task */

/* Rotation vector of a rotation, by its quaternion. */
static void rotation_vector(const double *E, double *w) {
  const double d[4] = {E[0], E[4], E[8], E[0] + E[4] + E[8]};
  double v[4], size, scale;
  int k = 0;
  for (int i = 1; i < 4; i++)
    if (d[i] > d[k]) k = i;
  if (k == 3) {
    v[0] = E[7] - E[5], v[1] = E[2] - E[6], v[2] = E[3] - E[1], v[3] = 1 + d[3];
  } else {
    const int i = (k + 1) % 3, j = (k + 2) % 3;
    v[k] = 1 - d[3] + 2 * E[4 * k];
    v[i] = E[3 * i + k] + E[3 * k + i];
    v[j] = E[3 * j + k] + E[3 * k + j];
    v[3] = E[3 * j + i] - E[3 * i + j];
  }
  size = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
  if (v[3] < 0)
    for (int i = 0; i < 4; i++) v[i] = -v[i];
  scale = size > 0 ? 2 * atan2(size, v[3]) / size : 0;
  for (int i = 0; i < 3; i++) w[i] = scale * v[i];
}

/* Task error from (p, R) to a goal. */
static void error(const Arm *arm, const double *p_goal, const double *R_goal, const double *p, const double *R,
                  double *e) {
  for (int i = 0; i < arm->m && i < 3; i++) {
    const int row = arm->kind == 2 ? arm->rows[i] : i;
    e[i] = p_goal[row] - p[row];
  }
  if (arm->kind == 0) {
    double E[9];
    for (int i = 0; i < 3; i++)
      for (int k = 0; k < 3; k++)
        E[3 * i + k] = R_goal[3 * i] * R[3 * k] + R_goal[3 * i + 1] * R[3 * k + 1] + R_goal[3 * i + 2] * R[3 * k + 2];
    rotation_vector(E, e + 3);
  } else if (arm->kind == 1) { /* the goal's axis as the tool sees it */
    double aim[3], sine, ratio;
    for (int i = 0; i < 3; i++) aim[i] = R[i] * R_goal[2] + R[3 + i] * R_goal[5] + R[6 + i] * R_goal[8];
    sine = hypot(aim[0], aim[1]);
    ratio = sine > 1e-12 ? atan2(sine, aim[2]) / sine : aim[2] > 0;
    e[3] = -aim[1] * ratio, e[4] = aim[0] * ratio;
    if (sine <= 1e-12 && aim[2] < 0) e[3] = 3.141592653589793, e[4] = 0;
  }
}

EXPORT void chart_place(const Arm *arm, long K, const double *Q, double *p, double *R, double *J) {
  const int n = arm->n, m = arm->m;
  for (long a = 0; a < K; a++) place(arm, Q + a * n, p + 3 * a, R + 9 * a, (double(*)[n])(J + a * m * n));
}

/* Newton's method at every row of Q (K, n), with steps of at most longest; then p, R, J and e there. */
EXPORT void chart_solve(const Arm *arm, long K, const double *p_goal, const double *R_goal, const double *q_ref,
                 const double *n_ref, const double *s, int iterations, double longest, double tolerance, double *Q,
                 double *R, double *J, double *residual, double *size) {
  const int n = arm->n, m = arm->m, r = n - m;
  double A[MOST * MOST], b[MOST], p[3];
  for (long a = 0; a < K; a++) {
    double *q = Q + a * n, *R_a = R + 9 * a;
    size[a] = HUGE_VAL;
    for (int step = 0; step < iterations; step++) {
      double largest = 0, share;
      place(arm, q, p, R_a, (double(*)[n])A);
      error(arm, p_goal + 3 * a, R_goal + 9 * a, p, R_a, b);
      for (int j = 0; j < r; j++) {
        b[m + j] = s[a * r + j];
        for (int i = 0; i < n; i++) {
          const double normal = A[(m + j) * n + i] = n_ref[(a * n + i) * r + j];
          b[m + j] -= normal * (q[i] - q_ref[a * n + i]);
        }
      }
      if (!(fabs(eliminate(n, A, b)) > 0)) break;
      substitute(n, A, b);
      for (int i = 0; i < n; i++) largest = !(fabs(b[i]) <= largest) ? fabs(b[i]) : largest;
      if (!(largest < HUGE_VAL)) {
        size[a] = HUGE_VAL;
        break;
      }
      size[a] = largest;
      share = largest > longest ? longest / largest : 1;
      for (int i = 0; i < n; i++) q[i] += share * b[i];
      if (largest <= tolerance) break;
    }
    place(arm, q, p, R_a, (double(*)[n])(J + a * m * n));
    error(arm, p_goal + 3 * a, R_goal + 9 * a, p, R_a, b);
    residual[a] = 0;
    for (int i = 0; i < m; i++) residual[a] = !(fabs(b[i]) <= residual[a]) ? fabs(b[i]) : residual[a];
  }
}
