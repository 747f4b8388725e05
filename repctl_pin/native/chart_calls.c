/* The chart as Python calls it: one pose in memory of its thread, and batches. */

#include <math.h>
#include <stddef.h>

#include "function.h"

typedef struct {
  int keep;
  const Arm *arm;
  const Chart *chart;
  double *target, *leaf, *result; /* 16: [R p; 0 1] by rows; N - M, N */
} ChartCall;

/* Read a homogeneous matrix by rows; its last row is tested to 1e-6. */
static int read_pose(const double X[16], Pose *x) {
  for (int i = 0; i < 3; i++) {
    x->p[i] = X[4 * i + 3];
    for (int k = 0; k < 3; k++) x->R[3 * i + k] = X[4 * i + k];
  }
  for (int i = 12; i < 16; i++)
    if (!(fabs(X[i] - (i == 15)) <= 1e-6)) return 0;
  return 1;
}

EXPORT int call_configuration(const ChartCall *call, int on_leaf) {
  Pose target;
  if (!read_pose(call->target, &target)) return BAD_NUMBER;
  return find_configuration(call->arm, call->chart, call->keep, &target, on_leaf ? call->leaf : NULL, call->result);
}

/* q at every target (count, 16) on its leaf (count, N - M); rows without q are NaN. */
EXPORT void call_configurations(const Arm *arm, const Chart *chart, int keep, long count, const double *X, const double *leaf,
                                double *Q) {
  for (long a = 0; a < count; a += AT_ONCE) {
    const int few = count - a < AT_ONCE ? (int)(count - a) : AT_ONCE;
    Pose targets[AT_ONCE];
    int status[AT_ONCE], read[AT_ONCE];
    for (int l = 0; l < few; l++) read[l] = read_pose(X + 16 * (a + l), targets + l);
    find_configurations(arm, chart, keep, few, targets, leaf + a * (N - M), N - M, Q + a * N, status);
    for (int l = 0; l < few; l++)
      for (int i = 0; i < N && !(read[l] && status[l] == OK); i++) Q[(a + l) * N + i] = HUGE_VAL - HUGE_VAL;
  }
}

/* Newton's method on f(q) = x, n_ref^T (q - q_ref) = s at every row of Q (count, N), n_ref (count, N, N - M); then R, J,
   the largest entry of the task error, and that of the last step. */
EXPORT void call_points(const Arm *arm, long count, const double *p_goal, const double *R_goal, const double *q_ref,
                        const double *n_ref, const double *s, int turns, double longest, double enough, double *Q,
                        double *R, double *J, double *residual, double *size) {
  for (long a = 0; a < count; a++) {
    double n_T[(N - M) * N], p[3], e[M];
    Pose goal;
    for (int i = 0; i < 3; i++) goal.p[i] = p_goal[3 * a + i];
    for (int i = 0; i < 9; i++) goal.R[i] = R_goal[9 * a + i];
    for (int i = 0; i < N; i++)
      for (int j = 0; j < N - M; j++) n_T[j * N + i] = n_ref[(a * N + i) * (N - M) + j];
    size[a] = solve_chart(arm, &goal, q_ref + a * N, n_T, s + a * (N - M), turns, longest, enough, Q + a * N);
    place(arm, Q + a * N, p, R + 9 * a, (double(*)[N])(J + a * M * N));
    task_error(arm, p, R + 9 * a, &goal, e);
    residual[a] = 0.0;
    for (int i = 0; i < M; i++) residual[a] = !(fabs(e[i]) <= residual[a]) ? fabs(e[i]) : residual[a];
  }
}
