/* Minimum joint speed by orthogonal rows: J^T = Q R by Gram and Schmidt's modified method, J^+ = Q R^-T. */

#include <math.h>
#include <stddef.h>

#include "arm.h"
#include "least_speed.h"

/* Replace the rows of J by those of Q^T, with the inverse diagonal of R in place of the diagonal; return 0 if a row of J
   is close to the span of those before it. A row of which little is left is made orthogonal twice. */
static int orthogonal_rows(const Arm *arm, double J[][N], double R[][M]) {
  for (int i = 0; i < M; i++) {
    double length = 0, before, rest;
    for (int j = 0; j < i; j++) R[j][i] = 0;
    for (int k = 0; k < N; k++) length += J[i][k] * J[i][k];
    rest = length;
    do {
      before = rest;
      rest = 0;
      for (int j = 0; j < i; j++) {
        double share = 0;
        for (int k = 0; k < N; k++) share += J[j][k] * J[i][k];
        for (int k = 0; k < N; k++) J[i][k] -= share * J[j][k];
        R[j][i] += share;
      }
      for (int k = 0; k < N; k++) rest += J[i][k] * J[i][k];
      if (!(rest > RANK_TOLERANCE * RANK_TOLERANCE * length)) return 0;
    } while (rest < 0.1 * before);
    R[i][i] = 1 / sqrt(rest);
    for (int k = 0; k < N; k++) J[i][k] *= R[i][i];
  }
  return 1;
}

/* Add Q R^-T b to z; b becomes R^-T b. */
static void add_least(const Arm *arm, double Q[][N], double R[][M], double b[], double z[]) {
  for (int i = 0; i < M; i++) {
    for (int j = 0; j < i; j++) b[i] -= R[j][i] * b[j];
    b[i] *= R[i][i];
    for (int k = 0; k < N; k++) z[k] += b[i] * Q[i][k];
  }
}

int least_speed(const Arm *arm, const double q[], const double xdot[], const double *posture, double gain,
                double qdot[]) {
  double p[3 * FRAMES], rotations[9 * FRAMES], J[M][N], R[M][M], b[M], z[N];
  if (!all_finite(q, N) || !all_finite(xdot, M)) return 0;
  place(arm, q, p, rotations, J);
  for (int k = 0; k < N; k++) z[k] = posture ? gain * (posture[k] - q[k]) : 0;
  for (int i = 0; i < M; i++) {
    b[i] = xdot[i];
    for (int k = 0; posture && k < N; k++) b[i] -= J[i][k] * z[k];
  }
  if (!orthogonal_rows(arm, J, R)) return 0;
  add_least(arm, J, R, b, z);
  if (!all_finite(z, N)) return 0;
  for (int k = 0; k < N; k++) qdot[k] = z[k];
  return 1;
}

int inverse_of_rows(const Arm *arm, double J[][N], double G[]) {
  double R[M][M];
  if (!orthogonal_rows(arm, J, R)) return 0;
  for (int a = 0; a < M; a++) {
    double b[M], column[N];
    for (int i = 0; i < M; i++) b[i] = i == a;
    for (int k = 0; k < N; k++) column[k] = 0;
    add_least(arm, J, R, b, column);
    for (int k = 0; k < N; k++) G[k * M + a] = column[k];
  }
  return all_finite(G, N * M);
}

int least_inverse(const Arm *arm, const double q[], double G[]) {
  double p[3 * FRAMES], rotations[9 * FRAMES], J[M][N];
  if (!all_finite(q, N)) return 0;
  place(arm, q, p, rotations, J);
  return inverse_of_rows(arm, J, G);
}
