/* An arm at q: kinematics and the task error; and linear equations of its size. */

#include <math.h>
#include <stddef.h>

#include "arm.h"

/* ---- kinematics ---- */

/* Write a column of the frame's Jacobian (v, omega) into column j of J, or add it to the columns that it drives. */
static void put_column(const Arm *arm, const double R[9], const double v[3], const double omega[3], int j,
                       double J[][N]) {
  double column[6] = {v[0], v[1], v[2], omega[0], omega[1], omega[2]};
  if (arm->kind == AXIS) { /* omega along the frame's own x and y */
    column[3] = R[0] * omega[0] + R[3] * omega[1] + R[6] * omega[2];
    column[4] = R[1] * omega[0] + R[4] * omega[1] + R[7] * omega[2];
  }
  UNROLLED for (int k = 0; k < ROWS; k++) {
    const double entry = arm->kind == POSITION ? v[arm->rows[k]] : column[k];
    if (!arm->coupled)
      J[k][j] = entry;
    else
      for (int i = 0; i < N; i++) J[k][i] += arm->S[j * N + i] * entry;
  }
}

/* Position, rotation, and J (ROWS, N) unless it is NULL, at q; of one frame. */
static void place_frame(const Arm *arm, const double q[], double p_out[3], double R_out[9], double J[][N]) {
  static const double none[3] = {0.0, 0.0, 0.0};
  double p[3], R[9], z[MOST_JOINTS][3], o[MOST_JOINTS][3];
  for (int i = 0; i < 9; i++) R[i] = arm->R[i];
  for (int i = 0; i < 3; i++) p[i] = arm->p[i];
  UNROLLED for (int j = 0; j < JOINTS; j++) {
    const double *B = arm->R + 9 * (j + 1), *t = arm->p + 3 * (j + 1);
    const int revolute = arm->revolute[j], bent = arm->bent[j];
    double theta = arm->coupled ? arm->offset[j] : q[j], c = 1.0, s = 0.0, slide;
    for (int i = 0; i < N && arm->coupled; i++) theta += arm->S[j * N + i] * q[i];
    slide = revolute ? t[2] : theta + t[2];
    if (revolute) {
      c = cos(theta);
      s = sin(theta);
    }
    UNROLLED for (int i = 0; i < 3; i++) {
      const double x = c * R[3 * i] + s * R[3 * i + 1], y = c * R[3 * i + 1] - s * R[3 * i], w = R[3 * i + 2];
      z[j][i] = w;
      o[j][i] = p[i];
      if (t[0] != 0.0) p[i] += x * t[0];
      if (t[1] != 0.0) p[i] += y * t[1];
      if (slide != 0.0) p[i] += w * slide;
      R[3 * i] = bent ? x : x * B[0] + y * B[3] + w * B[6]; /* the next joint, or the frame */
      R[3 * i + 1] = bent == 2 ? w * B[7] : bent ? y * B[4] + w * B[7] : x * B[1] + y * B[4] + w * B[7];
      R[3 * i + 2] = bent == 2 ? y * B[5] : bent ? y * B[5] + w * B[8] : x * B[2] + y * B[5] + w * B[8];
    }
  }
  for (int i = 0; i < 9; i++) R_out[i] = R[i];
  for (int i = 0; i < 3; i++) p_out[i] = p[i];
  if (!J) return;
  for (int k = 0; k < ROWS && arm->coupled; k++)
    for (int i = 0; i < N; i++) J[k][i] = 0.0;
  UNROLLED for (int j = 0; j < JOINTS; j++) {
    const double *a = z[j], x = p[0] - o[j][0], y = p[1] - o[j][1], w = p[2] - o[j][2];
    const double v[3] = {a[1] * w - a[2] * y, a[2] * x - a[0] * w, a[0] * y - a[1] * x};
    if (arm->revolute[j])
      put_column(arm, R, v, a, j, J);
    else
      put_column(arm, R, a, none, j, J);
  }
}

/* The same of all frames. */
SHARED void place(const Arm *arm, const double q[], double p[], double R[], double J[][N]) {
  if (FRAMES == 1) {
    place_frame(arm, q, p, R, J);
    return;
  }
  for (int f = 0, row = 0; f < FRAMES; row += arm->frame[f++].m)
    place_frame(arm->frame + f, q, p + 3 * f, R + 9 * f, J ? J + row : NULL);
}

/* Placements of all frames at q. */
SHARED void find_poses(const Arm *arm, const double q[], Pose pose[]) {
  for (int f = 0; f < FRAMES; f++) place_frame(FRAME(f), q, pose[f].p, pose[f].R, NULL);
}

/* ---- the task error ---- */

/* Test whether R is a rotation to 1e-6: two orthonormal rows, the third their cross product. */
SHARED int rotation(const double R[9]) {
  const double away[6] = {
      R[0] * R[0] + R[1] * R[1] + R[2] * R[2] - 1.0, R[3] * R[3] + R[4] * R[4] + R[5] * R[5] - 1.0,
      R[0] * R[3] + R[1] * R[4] + R[2] * R[5],       R[1] * R[5] - R[2] * R[4] - R[6],
      R[2] * R[3] - R[0] * R[5] - R[7],              R[0] * R[4] - R[1] * R[3] - R[8]};
  for (int i = 0; i < 6; i++)
    if (!(fabs(away[i]) < 1e-6)) return 0;
  return 1;
}

/* Divide an angle in [0, pi] by its sine, given the square of the sine and the cosine, or both times a length; the
   quotient is then divided by that length. Below 30 degrees it is a polynomial in the square. */
SHARED double angle_per_sine(double square, double cosine) {
  const double length = square + cosine * cosine, z = square / length, zz = z * z;
  if (cosine > 0.0 && z < 0.25)
    return (1.0 + z * (0.1666666666666662 + z * 0.07500000000033673
        + zz * (0.044642857088426066 + z * 0.03038194816511533
        + zz * (0.02237202440896431 + z * 0.017355665746480328
        + zz * (0.013925165918699349 + z * 0.011907635629904689
        + zz * (0.007654232351924293 + z * 0.01646436717361212
        + zz * (-0.011449691653251649 + z * 0.02866440773010254))))))) / sqrt(length);
  return atan2(sqrt(square), cosine) / sqrt(square);
}

/* Compute the rotation vector of a matrix, orthonormalised first: angle times axis, rad. */
static void log_rotation(const double E[9], double w[3]) {
  double x[3], y[3], z[3], a[3], length = 0.0, width = 0.0, square, cosine;
  for (int i = 0; i < 3; i++) {
    length += E[3 * i] * E[3 * i];
    width += E[3 * i + 1] * E[3 * i + 1];
  }
  length = 1.0 / sqrt(length);
  width = 1.0 / sqrt(width);
  for (int i = 0; i < 3; i++) {
    x[i] = E[3 * i] * length;
    y[i] = E[3 * i + 1] * width;
  }
  z[0] = x[1] * y[2] - x[2] * y[1];
  z[1] = x[2] * y[0] - x[0] * y[2];
  z[2] = x[0] * y[1] - x[1] * y[0];
  x[0] = y[1] * z[2] - y[2] * z[1];
  x[1] = y[2] * z[0] - y[0] * z[2];
  x[2] = y[0] * z[1] - y[1] * z[0];
  a[0] = (y[2] - z[1]) / 2.0; /* axis times sine */
  a[1] = (z[0] - x[2]) / 2.0;
  a[2] = (x[1] - y[0]) / 2.0;
  square = a[0] * a[0] + a[1] * a[1] + a[2] * a[2];
  cosine = (x[0] + y[1] + z[2] - 1.0) / 2.0;
  if (!(cosine < -0.9)) {
    const double scale = angle_per_sine(square, cosine);
    for (int i = 0; i < 3; i++) w[i] = a[i] * scale;
  } else { /* near half a turn: the axis from the symmetric part, its sign from the other */
    const double angle = atan2(sqrt(square), cosine), d[3] = {x[0], y[1], z[2]};
    const int k = d[0] >= d[1] ? (d[0] >= d[2] ? 0 : 2) : (d[1] >= d[2] ? 1 : 2);
    double axis[3], size;
    axis[0] = k == 0 ? 2.0 * (d[0] - cosine) : k == 1 ? x[1] + y[0] : x[2] + z[0];
    axis[1] = k == 1 ? 2.0 * (d[1] - cosine) : k == 0 ? x[1] + y[0] : y[2] + z[1];
    axis[2] = k == 2 ? 2.0 * (d[2] - cosine) : k == 0 ? x[2] + z[0] : y[2] + z[1];
    size = sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]);
    size *= a[k] < 0.0 ? -1.0 : 1.0;
    for (int i = 0; i < 3; i++) w[i] = axis[i] * angle / size;
  }
}

/* The shortest rotation about the frame's own x and y that aligns its z axis with the target's. */
static void axis_turn(const double R[9], const double goal[9], double e[2]) {
  const double z[3] = {R[2], R[5], R[8]}, aim[3] = {goal[2], goal[5], goal[8]};
  const double cosine = z[0] * aim[0] + z[1] * aim[1] + z[2] * aim[2];
  double turn[3] = {z[1] * aim[2] - z[2] * aim[1], z[2] * aim[0] - z[0] * aim[2], z[0] * aim[1] - z[1] * aim[0]};
  const double square = turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2];
  double share = 3.14159265358979323846;
  if (cosine <= 0.0 && square < 1e-24) /* opposite: half a turn in any direction */
    for (int i = 0; i < 3; i++) turn[i] = R[3 * i];
  else
    share = angle_per_sine(square, cosine);
  for (int k = 0; k < 2; k++) e[k] = (R[k] * turn[0] + R[3 + k] * turn[1] + R[6 + k] * turn[2]) * share;
}

/* e = (p* - p, log(R* R^T)), or its rows of the task; for AXIS, the shortest rotation of the tool's axis. */
SHARED void frame_error(const Arm *arm, const double p[3], const double R[9], const Pose *target, double e[]) {
  for (int i = 0; i < ROWS && i < 3; i++) {
    const int row = arm->kind == POSITION ? arm->rows[i] : i;
    e[i] = target->p[row] - p[row];
  }
  if (arm->kind == POSE) {
    double E[9];
    for (int i = 0; i < 3; i++)
      for (int k = 0; k < 3; k++)
        E[3 * i + k] = target->R[3 * i] * R[3 * k] + target->R[3 * i + 1] * R[3 * k + 1]
                       + target->R[3 * i + 2] * R[3 * k + 2];
    log_rotation(E, e + 3);
  } else if (arm->kind == AXIS)
    axis_turn(R, target->R, e + 3);
}

/* The same of all frames. */
SHARED void task_error(const Arm *arm, const double p[], const double R[], const Pose *target, double e[]) {
  if (FRAMES == 1) {
    frame_error(arm, p, R, target, e);
    return;
  }
  for (int f = 0; f < FRAMES; e += arm->frame[f++].m)
    frame_error(arm->frame + f, p + 3 * f, R + 9 * f, target + f, e);
}

/* Test whether the targets of all frames are rotations, where their kinds have rows of omega. */
SHARED int usable(const Arm *arm, const Pose *target) {
  if (FRAMES == 1) return arm->kind == POSITION || rotation(target->R);
  for (int f = 0; f < FRAMES; f++)
    if (!(arm->frame[f].kind == POSITION || rotation(target[f].R))) return 0;
  return 1;
}

/* b <- b + dt xdot, with xdot of the frame's twist (v, omega). */
SHARED void add_frame_rate(const Arm *arm, const double R[9], const double twist[6], double dt, double b[]) {
  for (int i = 0; i < ROWS; i++) {
    double rate = twist[arm->kind == POSITION ? arm->rows[i] : i];
    if (arm->kind == AXIS && i > 2) rate = R[i - 3] * twist[3] + R[i] * twist[4] + R[i + 3] * twist[5];
    b[i] += dt * rate;
  }
}

/* The same of all frames. */
SHARED void add_rate(const Arm *arm, const double R[], const double twist[], double dt, double b[]) {
  if (FRAMES == 1) {
    add_frame_rate(arm, R, twist, dt, b);
    return;
  }
  for (int f = 0; f < FRAMES; b += arm->frame[f++].m)
    add_frame_rate(arm->frame + f, R + 9 * f, twist + 6 * f, dt, b);
}

/* ---- linear equations ---- */

SHARED int all_finite(const double *x, int count) {
  for (int i = 0; i < count; i++)
    if (!(fabs(x[i]) < HUGE_VAL)) return 0;
  return 1;
}

/* Factor A = P L U in place, with 1 / U on the diagonal; return 0 if a pivot is 0 or not finite. */
SHARED int factor(const Arm *arm, double A[][N], int swap[]) {
  (void)arm;
  UNROLLED for (int k = 0; k < N; k++) {
    double size = fabs(A[k][k]), scale;
    int best = k;
    for (int i = k + 1; i < N; i++)
      if (fabs(A[i][k]) > size) {
        size = fabs(A[i][k]);
        best = i;
      }
    if (!(size > 0.0)) return 0;
    swap[k] = best;
    if (best != k)
      for (int j = 0; j < N; j++) {
        const double a = A[k][j];
        A[k][j] = A[best][j];
        A[best][j] = a;
      }
    scale = A[k][k] = 1.0 / A[k][k];
    UNROLLED for (int i = k + 1; i < N; i++) {
      const double l = A[i][k] *= scale;
      UNROLLED for (int j = k + 1; j < N; j++) A[i][j] -= l * A[k][j];
    }
  }
  return 1;
}

/* Solve x <- A^-1 x with the factors of A. */
SHARED void solve(const Arm *arm, double LU[][N], const int swap[], double x[]) {
  (void)arm;
  for (int k = 0; k < N; k++) {
    const double a = x[swap[k]];
    x[swap[k]] = x[k];
    x[k] = a;
  }
  UNROLLED for (int k = 0; k < N; k++)
    UNROLLED for (int i = k + 1; i < N; i++) x[i] -= LU[i][k] * x[k];
  UNROLLED for (int k = N - 1; k >= 0; k--) {
    x[k] *= LU[k][k];
    UNROLLED for (int i = 0; i < k; i++) x[i] -= LU[i][k] * x[k];
  }
}

/* Solve for one column of A^-1. */
static void solve_unit(const Arm *arm, double LU[][N], const int swap[], int column, double x[]) {
  for (int k = 0; k < N; k++) x[k] = k == column;
  solve(arm, LU, swap, x);
}

/* Factor A; return 0 if A is singular: a row is close to the span of the others. The sine of their angle is
   1 / (|row i of A| |column i of A^-1|) >= |det A| / prod |row|; this bound is tested first. */
SHARED int regular(const Arm *arm, double A[][N], int swap[]) {
  double rows[N], all = 1.0, det = 1.0;
  for (int i = 0; i < N; i++) {
    rows[i] = 0.0;
    for (int k = 0; k < N; k++) rows[i] += A[i][k] * A[i][k];
    all *= rows[i];
  }
  if (!factor(arm, A, swap)) return 0;
  for (int i = 0; i < N; i++) det *= A[i][i]; /* 1 / det */
  if (all * det * det < 0.5 / (RANK_TOLERANCE * RANK_TOLERANCE) && all > 1e-200 && fabs(det) > 1e-100) return 1;
  for (int i = 0; i < N; i++) {
    double column[N], size = 0.0;
    solve_unit(arm, A, swap, i, column);
    for (int k = 0; k < N; k++) size += column[k] * column[k];
    if (!(rows[i] * size < 1.0 / (RANK_TOLERANCE * RANK_TOLERANCE))) return 0;
  }
  return 1;
}

/* Singular value decomposition A V = U S by one-sided Jacobi rotations: A becomes U S, V orthogonal. */
SHARED void decompose(const Arm *arm, double A[][N], double V[][N]) {
  int turned = 1;
  (void)arm;
  for (int i = 0; i < N; i++)
    for (int j = 0; j < N; j++) V[i][j] = i == j;
  for (int sweep = 0; sweep < 40 && turned; sweep++) {
    turned = 0;
    for (int i = 0; i < N - 1; i++)
      for (int j = i + 1; j < N; j++) {
        double a = 0.0, b = 0.0, g = 0.0, z, t, c, s;
        for (int k = 0; k < N; k++) {
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
        for (int k = 0; k < N; k++) {
          const double left = A[k][i], right = A[k][j], first = V[k][i], second = V[k][j];
          A[k][i] = c * left - s * right;
          A[k][j] = s * left + c * right;
          V[k][i] = c * first - s * second;
          V[k][j] = s * first + c * second;
        }
      }
  }
}

/* Damping near singularities: x = sum v_i s_i / (s_i^2 + lambda^2) u_i^T b, lambda^2 = most^2 (1 - (s_min / 2 most)^2)
   if s_min < 2 most, else 0. Far from singularities the factors are L and U. */
SHARED void damp(const Arm *arm, Factors *factors, double most) {
  double(*A)[N] = (double(*)[N])factors->A, kept[N][N], norm = 0.0, least = HUGE_VAL, ratio;
  for (int i = 0; i < N; i++)
    for (int k = 0; k < N; k++) kept[i][k] = A[i][k];
  factors->by_values = 0;
  factors->square = 0.0;
  if (factor(arm, A, factors->swap)) {
    for (int k = 0; k < N; k++) {
      double column[N];
      solve_unit(arm, A, factors->swap, k, column);
      for (int i = 0; i < N; i++) norm += column[i] * column[i];
    }
    if (sqrt(norm) < 1.0 / (2.0 * most)) return; /* s_min >= 1 / |A^-1|_F: far from singularities */
  }
  factors->by_values = 1;
  for (int i = 0; i < N; i++)
    for (int k = 0; k < N; k++) A[i][k] = kept[i][k];
  decompose(arm, A, (double(*)[N])factors->V);
  for (int i = 0; i < N; i++) {
    factors->s[i] = 0.0;
    for (int k = 0; k < N; k++) factors->s[i] += A[k][i] * A[k][i];
    if (!(factors->s[i] >= least)) least = factors->s[i];
  }
  ratio = sqrt(least) / (2.0 * most);
  if (ratio < 1.0) factors->square = most * most * (1.0 - ratio * ratio);
}

/* Compute x = J_V^-1 b, damped if damp() found a singularity near. */
SHARED void apply_factors(const Arm *arm, const Factors *factors, const double b[], double x[]) {
  double(*A)[N] = (double(*)[N])factors->A, (*V)[N] = (double(*)[N])factors->V;
  for (int i = 0; i < N; i++) x[i] = factors->by_values ? 0.0 : b[i];
  if (!factors->by_values) {
    solve(arm, A, factors->swap, x);
    return;
  }
  for (int i = 0; i < N; i++) {
    double share = 0.0;
    for (int k = 0; k < N; k++) share += A[k][i] * b[k];
    share /= factors->s[i] + factors->square;
    for (int k = 0; k < N; k++) x[k] += V[k][i] * share;
  }
}

/* ---- limits ---- */

/* Test whether the joints are within their limits, up to rounding. */
SHARED int within_limits(const Arm *arm, const double q[]) {
  for (int i = 0; i < N; i++)
    if (!(q[i] >= arm->lower[i] - 1e-9 && q[i] <= arm->upper[i] + 1e-9)) return 0;
  return 1;
}
