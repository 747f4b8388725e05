/* Newton's method on f(q) = x, n_ref^T (q - q_ref) = s, at many poses.

   The same mathematics as kinematics.py and chart.py, one pose at a time. */

#include <math.h>

#include "chain.h"

enum { MOST = 32 }; /* joints of a task */

/* Rotation vector of a rotation, by its quaternion. */
static void rotation_vector(const double *M, double *w) {
  const double d[4] = {M[0], M[4], M[8], M[0] + M[4] + M[8]};
  double v[4], size, scale;
  int k = 0;
  for (int i = 1; i < 4; i++)
    if (d[i] > d[k]) k = i;
  if (k == 3) {
    v[0] = M[7] - M[5], v[1] = M[2] - M[6], v[2] = M[3] - M[1], v[3] = 1 + d[3];
  } else {
    const int i = (k + 1) % 3, j = (k + 2) % 3;
    v[k] = 1 - d[3] + 2 * M[4 * k];
    v[i] = M[3 * i + k] + M[3 * k + i];
    v[j] = M[3 * j + k] + M[3 * k + j];
    v[3] = M[3 * j + i] - M[3 * i + j];
  }
  size = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
  if (v[3] < 0)
    for (int i = 0; i < 4; i++) v[i] = -v[i];
  scale = size > 0 ? 2 * atan2(size, v[3]) / size : 0;
  for (int i = 0; i < 3; i++) w[i] = scale * v[i];
}

/* Task error from (p, R) to a goal. */
static void error(const Chain *chain, const double *p_goal, const double *R_goal, const double *p, const double *R,
                  double *e) {
  for (int i = 0; i < chain->m && i < 3; i++) {
    const int row = chain->kind == 2 ? chain->rows[i] : i;
    e[i] = p_goal[row] - p[row];
  }
  if (chain->kind == 0) {
    double M[9];
    for (int i = 0; i < 3; i++)
      for (int k = 0; k < 3; k++)
        M[3 * i + k] = R_goal[3 * i] * R[3 * k] + R_goal[3 * i + 1] * R[3 * k + 1] + R_goal[3 * i + 2] * R[3 * k + 2];
    rotation_vector(M, e + 3);
  } else if (chain->kind == 1) { /* the goal's axis as the tool sees it */
    double aim[3], sine, ratio;
    for (int i = 0; i < 3; i++) aim[i] = R[i] * R_goal[2] + R[3 + i] * R_goal[5] + R[6 + i] * R_goal[8];
    sine = hypot(aim[0], aim[1]);
    ratio = sine > 1e-12 ? atan2(sine, aim[2]) / sine : aim[2] > 0;
    e[3] = -aim[1] * ratio, e[4] = aim[0] * ratio;
    if (sine <= 1e-12 && aim[2] < 0) e[3] = 3.141592653589793, e[4] = 0;
  }
}

EXPORT void chart_place(const Chain *chain, long K, const double *Q, double *p, double *R, double *J) {
  const int n = chain->n, m = chain->m;
  for (long a = 0; a < K; a++) place(chain, Q + a * n, p + 3 * a, R + 9 * a, J + a * m * n);
}

/* Newton's method at every row of Q (K, n), with steps of at most longest; then p, R, J and e there. */
EXPORT void chart_solve(const Chain *chain, long K, const double *p_goal, const double *R_goal, const double *q_ref,
                 const double *n_ref, const double *s, int iterations, double longest, double tolerance, double *Q,
                 double *R, double *J, double *residual, double *size) {
  const int n = chain->n, m = chain->m, r = n - m;
  double A[MOST * MOST], b[MOST], p[3];
  for (long a = 0; a < K; a++) {
    double *q = Q + a * n, *R_a = R + 9 * a;
    size[a] = HUGE_VAL;
    for (int step = 0; step < iterations; step++) {
      double largest = 0, share;
      place(chain, q, p, R_a, A);
      error(chain, p_goal + 3 * a, R_goal + 9 * a, p, R_a, b);
      for (int j = 0; j < r; j++) {
        b[m + j] = s[a * r + j];
        for (int i = 0; i < n; i++) {
          const double N = A[(m + j) * n + i] = n_ref[(a * n + i) * r + j];
          b[m + j] -= N * (q[i] - q_ref[a * n + i]);
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
    place(chain, q, p, R_a, J + a * m * n);
    error(chain, p_goal + 3 * a, R_goal + 9 * a, p, R_a, b);
    residual[a] = 0;
    for (int i = 0; i < m; i++) residual[a] = !(fabs(b[i]) <= residual[a]) ? fabs(b[i]) : residual[a];
  }
}
