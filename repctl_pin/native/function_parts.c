/* The parts of q = F(x; c): targets and limits of a chart, and Newton's method with exchanges. function.c puts them together. */

#include <math.h>

#include "function.h"

/* Newton's method with exchanges of rows on [x - f(q); c - n_ref^T (q - q_ref)], n_ref^T (N - M, N), with steps of at
   most longest; return the size of the last step, HUGE_VAL if there is none. */
SHARED double solve_chart(const Arm *arm, const Pose *target, const double *q_ref, const double *n_ref,
                          const double *level, int turns, double longest, double enough, double q[]) {
  double A[N][N], b[N], p[3], R[9], size = HUGE_VAL;
  int swap[N];
  for (int turn = 0; turn < turns && !(size <= enough); turn++) {
    double share;
    place(arm, q, p, R, A);
    task_error(arm, p, R, target, b);
    for (int j = 0; j < N - M; j++) {
      b[M + j] = level ? level[j] : 0.0;
      for (int i = 0; i < N; i++) {
        A[M + j][i] = n_ref[j * N + i];
        b[M + j] += A[M + j][i] * (q_ref[i] - q[i]);
      }
    }
    if (!factor(arm, A, swap)) return HUGE_VAL;
    solve(arm, A, swap, b);
    if (!all_finite(b, N)) return HUGE_VAL;
    size = 0.0;
    for (int i = 0; i < N; i++)
      if (fabs(b[i]) > size) size = fabs(b[i]);
    share = size <= longest ? 1.0 : longest / size;
    for (int i = 0; i < N; i++) q[i] += share * b[i];
  }
  return size;
}

SHARED int joints_allowed(const Arm *arm, int keep, const double *leaf, const double q[]) {
  int checked = keep;
  for (int j = 0; leaf && j < N - M; j++)
    if (leaf[j] != 0.0) checked = 1;
  for (int i = 0; i < N && checked; i++)
    if (!(q[i] >= arm->lower[i] && q[i] <= arm->upper[i])) return 0;
  return 1;
}

/* u of a target, and what the symmetries add to q_ref there; check the target. */
SHARED int find_coordinates(const Arm *arm, const Chart *chart, const Pose *target, double u[], double shift[]) {
  double y[6];
  if (!(arm->kind == POSITION || rotation(target->R))) return BAD_NUMBER;
  cell_coordinates(arm, chart, target, y);
  if (!all_finite(y, M)) return BAD_NUMBER;
  scaled_coordinates(arm, chart, y, u, shift);
  return holds(arm, chart, y) ? OK : OUTSIDE;
}
