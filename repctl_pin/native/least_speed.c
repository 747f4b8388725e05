/* Minimum joint speed by Cholesky's factors of J J^T. */

#include <math.h>
#include <stddef.h>

#include "arm.h"
#include "least_speed.h"

#define WELL_CONDITIONED 1e-2 /* minimum sine of the angle between a row of J and the span of the others */

int least_speed(const Arm *arm, const double q[], const double xdot[], const double *posture, double gain,
                double qdot[]) {
  double p[3 * FRAMES], R[9 * FRAMES], J[M][N], L[M][M], y[M], z[N], squares = 1, pivots = 1;
  if (!all_finite(q, N) || !all_finite(xdot, M)) return 0;
  place(arm, q, p, R, J);
  for (int k = 0; k < N; k++) z[k] = posture ? gain * (posture[k] - q[k]) : 0;
  for (int i = 0; i < M; i++) { /* J J^T = L L^T, and L y = xdot - J z */
    y[i] = xdot[i];
    for (int k = 0; k < N; k++) y[i] -= J[i][k] * z[k];
    for (int j = 0; j <= i; j++) {
      double sum = 0;
      for (int k = 0; k < N; k++) sum += J[i][k] * J[j][k];
      if (i == j) squares *= sum;
      for (int k = 0; k < j; k++) sum -= L[i][k] * L[j][k];
      if (i > j)
        L[i][j] = sum / L[j][j];
      else if (sum > 0)
        L[i][i] = sqrt(sum);
      else
        return 0;
    }
    for (int j = 0; j < i; j++) y[i] -= L[i][j] * y[j];
    y[i] /= L[i][i];
    pivots *= L[i][i];
  }
  /* the pivots satisfy prod p <= sin prod |row|^2, with the smallest such angle */
  if (!(pivots * pivots > WELL_CONDITIONED * WELL_CONDITIONED * squares)) return 0;
  for (int i = M - 1; i >= 0; i--) {
    for (int j = i + 1; j < M; j++) y[i] -= L[j][i] * y[j];
    y[i] /= L[i][i];
    for (int k = 0; k < N; k++) z[k] += y[i] * J[i][k];
  }
  if (!all_finite(z, N)) return 0;
  for (int k = 0; k < N; k++) qdot[k] = z[k];
  return 1;
}
