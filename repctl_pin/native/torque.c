/* Joint torques: tau = H J_V^-1 ([xddot; hddot - d] - J_V' qdot) + bias, with the inertia H. */

#include <math.h>
#include <stddef.h>

#include "law.h"
#include "torque.h"

#define DIFFERENCE 1e-3 /* half the length of the central difference along qdot, rad or m */

static int usable_gains(const Arm *arm, const Gains *gains) {
  const double numbers[4] = {gains->damping, gains->leaf_frequency, gains->leaf_damping, gains->observer_rate};
  (void)arm;
  for (int i = 0; i < M; i++)
    if (!(gains->stiffness[i] > 0.0 && gains->stiffness[i] < HUGE_VAL)) return 0;
  for (int i = 0; i < N; i++)
    if (!(gains->observer_limit[i] > 0.0)) return 0;
  for (int i = 0; i < 4; i++)
    if (!(numbers[i] >= 0.0 && numbers[i] < HUGE_VAL)) return 0;
  return gains->observer_rate > 0.0;
}

/* Compute y = A x. */
static void multiply(const Arm *arm, double A[][N], const double x[], double y[]) {
  (void)arm;
  for (int i = 0; i < N; i++) {
    y[i] = 0.0;
    for (int k = 0; k < N; k++) y[i] += A[i][k] * x[k];
  }
}

/* Evaluate J_V and h at q, and where the frames are. */
static void evaluate(const Arm *arm, const double q[], double p[], double R[], double A[][N], double h[]) {
  place(arm, q, p, R, A);
  potentials(arm, q, p, R, A, h, A + M);
}

/* Evaluate J_V' qdot, the rate of J_V times qdot, by a central difference along qdot. */
static void curvature(const Arm *arm, const double q[], const double qdot[], double bent[]) {
  double A[N][N], there[N], ends[2][N], p[3 * FRAMES], R[9 * FRAMES], h[N], speed = 0.0, step;
  for (int i = 0; i < N; i++) {
    bent[i] = 0.0;
    speed += qdot[i] * qdot[i];
  }
  speed = sqrt(speed);
  if (speed == 0.0) return;
  step = DIFFERENCE / speed;
  for (int end = 0; end < 2; end++) {
    for (int i = 0; i < N; i++) there[i] = q[i] + (end ? -step : step) * qdot[i];
    evaluate(arm, there, p, R, A, h);
    multiply(arm, A, qdot, ends[end]);
  }
  for (int i = 0; i < N; i++) bent[i] = (ends[0][i] - ends[1][i]) * (0.5 / step);
}

/* Factor a symmetric H = L L^T; return 0 if H is not symmetric and positive definite. */
static int cholesky(const Arm *arm, const double H[], double L[][N]) {
  (void)arm;
  for (int i = 0; i < N; i++)
    for (int j = 0; j <= i; j++) {
      const double other = H[j * N + i];
      double sum = H[i * N + j];
      if (!(fabs(sum - other) <= 1e-9 * sqrt(fabs(H[i * N + i] * H[j * N + j])))) return 0;
      for (int k = 0; k < j; k++) sum -= L[i][k] * L[j][k];
      if (i > j)
        L[i][j] = sum / L[j][j];
      else if (sum > 0.0)
        L[i][i] = sqrt(sum);
      else
        return 0;
    }
  return 1;
}

/* Compute xddot of the spring and damper from the error e and its rate: with W = sqrt(K) J L^-T and W W^T = U k U^T,
   sqrt(K) xddot = U (k U^T sqrt(K) e + 2 damping sqrt(k) U^T sqrt(K) rate). */
static void pull_hand(const Arm *arm, double L[][N], double J[][N], const Gains *gains, const double e[],
                      const double rate[], double xddot[]) {
  double W[N][N], U[N][N], y[M];
  for (int a = 0; a < N; a++)
    for (int i = 0; i < N; i++) { /* column a: L^-1 sqrt(K_a) J_a; 0 beyond the rows of J */
      W[i][a] = a < M ? sqrt(gains->stiffness[a]) * J[a][i] : 0.0;
      for (int k = 0; k < i; k++) W[i][a] -= L[i][k] * W[k][a];
      W[i][a] /= L[i][i];
    }
  decompose(arm, W, U);
  for (int a = 0; a < M; a++) y[a] = 0.0;
  for (int k = 0; k < N; k++) {
    double square = 0.0, spring = 0.0, damper = 0.0, pull;
    for (int i = 0; i < N; i++) square += W[i][k] * W[i][k];
    for (int a = 0; a < M; a++) {
      spring += U[a][k] * sqrt(gains->stiffness[a]) * e[a];
      damper += U[a][k] * sqrt(gains->stiffness[a]) * rate[a];
    }
    pull = square * spring + 2.0 * gains->damping * sqrt(square) * damper;
    for (int a = 0; a < M; a++) y[a] += U[a][k] * pull;
  }
  for (int a = 0; a < M; a++) xddot[a] = y[a] / sqrt(gains->stiffness[a]);
}

/* Compute the torques; twist: NULL is 0; observer (N - M): its state, which the call updates; NULL: no observer. */
SHARED int joint_torques(const Arm *arm, const double q[], const double qdot[], const double inertia[],
                       const double bias[], const Pose *target, const double *twist, const double leaf[],
                       const Gains *gains, double dt, double *observer, double tau[]) {
  double A[N][N], L[N][N], p[3 * FRAMES], R[9 * FRAMES], h[N], e[N], rates[N], lag[M];
  double x[N], d[N], force[N], opposed[N], pull[N], estimate[N], share = 1.0;
  int swap[N];

  if (!all_finite(q, N) || !all_finite(qdot, N) || !all_finite(inertia, N * N)) return BAD_NUMBER;
  if (!all_finite(bias, N) || !all_finite(leaf, N - M)) return BAD_NUMBER;
  if (!usable(arm, target)) return BAD_NUMBER;
  if (!usable_gains(arm, gains) || !cholesky(arm, inertia, L)) return BAD_NUMBER;
  if (observer && !(all_finite(observer, N - M) && dt > 0.0 && gains->observer_rate * dt <= 1.0)) return BAD_NUMBER;

  curvature(arm, q, qdot, x);
  evaluate(arm, q, p, R, A, h);
  task_error(arm, p, R, target, e);
  multiply(arm, A, qdot, rates);
  for (int i = 0; i < M; i++) lag[i] = 0.0;
  if (twist) add_rate(arm, R, twist, 1.0, lag);
  for (int i = 0; i < M; i++) lag[i] -= rates[i];
  if (!all_finite(e, M) || !all_finite(lag, M) || !all_finite(x, N)) return BAD_NUMBER;
  for (int i = 0; i < N; i++)
    if (!all_finite(A[i], N)) return BAD_NUMBER;

  pull_hand(arm, L, A, gains, e, lag, force);
  for (int i = 0; i < N; i++) d[i] = 0.0;
  for (int i = 0; i < N - M; i++) {
    const double omega = gains->leaf_frequency, hdot = rates[M + i];
    pull[i] = omega * omega * (leaf[i] - h[i]) - 2.0 * gains->leaf_damping * omega * hdot;
    estimate[i] = observer ? gains->observer_rate * (hdot - observer[i]) : 0.0;
    force[M + i] = pull[i];
    d[M + i] = estimate[i];
  }
  for (int i = 0; i < N; i++) x[i] = force[i] - x[i];
  if (!all_finite(x, N) || !all_finite(d, N)) return BAD_NUMBER;
  if (!regular(arm, A, swap)) return SINGULAR;
  solve(arm, A, swap, x);
  solve(arm, A, swap, d);

  for (int i = 0; i < N; i++) {
    force[i] = opposed[i] = 0.0;
    for (int k = 0; k < N; k++) {
      force[i] += inertia[i * N + k] * x[k];
      opposed[i] += inertia[i * N + k] * d[k];
    }
    if (fabs(opposed[i]) * share > gains->observer_limit[i]) share = gains->observer_limit[i] / fabs(opposed[i]);
  }
  for (int i = 0; i < N; i++) force[i] += bias[i] - share * opposed[i];
  if (!all_finite(force, N)) return BAD_NUMBER;
  if (observer) {
    for (int i = 0; i < N - M; i++)
      estimate[i] = rates[M + i] - share / gains->observer_rate * estimate[i] + dt * pull[i];
    if (!all_finite(estimate, N - M)) return BAD_NUMBER;
    for (int i = 0; i < N - M; i++) observer[i] = estimate[i];
  }
  for (int i = 0; i < N; i++) tau[i] = force[i];
  return OK;
}
