/* Forward kinematics and the Jacobian of a serial chain, and linear equations. */

#include <math.h>

#include "chain.h"

void place(const Chain *chain, const double *q, double *p, double *R, double *J) {
  double E[9], z[MOST_JOINTS][3], o[MOST_JOINTS][3];
  const int n = chain->n, m = chain->m;
  for (int i = 0; i < 9; i++) R[i] = i % 4 == 0;
  for (int i = 0; i < 3; i++) p[i] = 0;
  for (int j = 0; j <= chain->P; j++) {
    double theta = 0;
    add_turned(R, chain->p + 3 * j, p);
    times(R, chain->R + 9 * j, 0, R);
    if (j == chain->P) break;
    for (int i = 0; i < n; i++) theta += chain->S[j * n + i] * q[i];
    theta += chain->offset[j];
    apply(R, chain->axis + 3 * j, z[j]);
    for (int i = 0; i < 3; i++) o[j][i] = p[i];
    if (chain->revolute[j]) {
      turn(chain->axis + 3 * j, sin(theta), cos(theta), E);
      times(R, E, 0, R);
    } else
      for (int i = 0; i < 3; i++) p[i] += theta * z[j][i];
  }
  for (int i = 0; i < m * n; i++) J[i] = 0;
  for (int j = 0; j < chain->P; j++) {
    const double *a = z[j], d[3] = {p[0] - o[j][0], p[1] - o[j][1], p[2] - o[j][2]};
    double twist[6] = {a[0], a[1], a[2], 0, 0, 0}, column[6];
    if (chain->revolute[j]) {
      cross(a, d, twist);
      for (int i = 0; i < 3; i++) twist[3 + i] = a[i];
    }
    for (int i = 0; i < m; i++)
      column[i] = chain->kind == 2 ? twist[chain->rows[i]]
                  : chain->kind == 0 || i < 3 ? twist[i]
                                              : R[i - 3] * twist[3] + R[i] * twist[4] + R[i + 3] * twist[5];
    for (int i = 0; i < n; i++) {
      const double share = chain->S[j * n + i];
      if (share != 0)
        for (int k = 0; k < m; k++) J[k * n + i] += share * column[k];
    }
  }
}

double eliminate(int n, double *A, double *b) {
  double pivots = 1;
  for (int j = 0; j < n; j++) { /* the largest pivot of each column */
    int best = j;
    for (int i = j + 1; i < n; i++)
      if (fabs(A[i * n + j]) > fabs(A[best * n + j])) best = i;
    for (int k = j; k < n && best != j; k++) {
      const double a = A[j * n + k];
      A[j * n + k] = A[best * n + k], A[best * n + k] = a;
    }
    const double x = b[j];
    b[j] = b[best], b[best] = x;
    pivots *= A[j * n + j];
    for (int i = j + 1; i < n; i++) {
      const double f = A[i * n + j] / A[j * n + j];
      for (int k = j + 1; k < n; k++) A[i * n + k] -= f * A[j * n + k];
      b[i] -= f * b[j];
    }
  }
  return pivots;
}

void substitute(int n, const double *A, double *b) {
  for (int i = n - 1; i >= 0; i--) {
    for (int k = i + 1; k < n; k++) b[i] -= A[i * n + k] * b[k];
    b[i] /= A[i * n + i];
  }
}
