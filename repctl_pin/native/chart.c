/* Coordinates of cells, and the potentials of a chart. */

#include <math.h>

#include "chart.h"

static void turned(const double *A, const double *x, double *y) {
  for (int i = 0; i < 3; i++) y[i] = A[3 * i] * x[0] + A[3 * i + 1] * x[1] + A[3 * i + 2] * x[2];
}

static void turned_back(const double *A, const double *x, double *y) {
  for (int i = 0; i < 3; i++) y[i] = A[i] * x[0] + A[3 + i] * x[1] + A[6 + i] * x[2];
}

/* ---- coordinates of a placement ---- */

/* The two tilts and the spin, e, of a rotation R after a rotation by the negative angle of this cosine and sine:
   R_0^T R_a(-angle) R = T = exp(e_x, e_y, 0) R_z(e_z). No other angle is needed. */
static void tilts_and_spin(const Chart *chart, const double R[9], double c, double s, double e[3]) {
  const double *B = chart->basis, *C = chart->turn;
  double S[9], T[9], square, share, length, along;
  for (int j = 0; j < 3; j++) {
    double x[3];
    for (int i = 0; i < 3; i++) x[i] = B[3 * i] * R[j] + B[3 * i + 1] * R[3 + j] + B[3 * i + 2] * R[6 + j];
    S[j] = c * x[0] + s * x[1];
    S[3 + j] = c * x[1] - s * x[0];
    S[6 + j] = x[2];
  }
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) T[3 * i + j] = C[i] * S[j] + C[3 + i] * S[3 + j] + C[6 + i] * S[6 + j];
  square = T[2] * T[2] + T[5] * T[5]; /* of the sine of the tilt; T[8] is its cosine */
  if (!(T[8] > 0.0) && square < 1e-24) { /* upside down */
    e[0] = 3.14159265358979323846;
    e[1] = 0.0;
    e[2] = atan2(-T[3], T[0]);
    return;
  }
  share = angle_per_sine(square, T[8]);
  e[0] = -T[5] * share;
  e[1] = T[2] * share;
  /* the first column of exp(-tilt) T is (cos spin, sin spin, 0); both are multiplied by length */
  length = sqrt(square + T[8] * T[8]);
  along = (T[5] * T[0] - T[2] * T[3]) * (T[8] > 0.0 ? 1.0 / (length + T[8]) : (length - T[8]) / square);
  e[2] = atan2(T[3] * T[8] - T[5] * T[6] - T[2] * along, T[0] * T[8] - T[2] * T[6] + T[5] * along);
}

/* Bend and stretch of a sector's radius at a height above its middle, and their derivatives, as in Profile.at. */
static void sides_at(const Chart *chart, double height, double side[2], double slope[2]) {
  const double most = chart->bent ? chart->bounds[2] : 0.0;
  const double x = height > most ? most : height < -most ? -most : height;
  for (int i = 0; i < 2; i++) {
    const double *c = chart->profile + i * (chart->bent + 1);
    side[i] = c[chart->bent];
    slope[i] = 0.0;
    for (int k = chart->bent - 1; k >= 0; k--) {
      slope[i] = slope[i] * x + side[i];
      side[i] = side[i] * x + c[k];
    }
    if (!(fabs(height) <= most)) slope[i] = 0.0;
  }
}

/* y (M) of a placement. */
SHARED void cell_coordinates(const Arm *arm, const Chart *chart, const Pose *x, double y[]) {
  const double whole = 6.283185307179586;
  double d[3], at[3], all[6], radius, side[2], slope[2];
  if (!chart->sector) {
    task_error(arm, chart->p, chart->R, x, y);
    return;
  }
  for (int i = 0; i < 3; i++) d[i] = x->p[i] - chart->origin[i];
  turned(chart->basis, d, at);
  radius = sqrt(at[0] * at[0] + at[1] * at[1]);
  all[1] = atan2(at[1], at[0]);
  all[2] = at[2] - chart->height;
  sides_at(chart, all[2], side, slope);
  all[0] = (radius - chart->radius - side[0]) / side[1];
  if (M > 3) {
    tilts_and_spin(chart, x->R, radius > 0.0 ? at[0] / radius : 1.0, radius > 0.0 ? at[1] / radius : 0.0, all + 3);
    all[5] -= whole * rint((all[5] - chart->spin) / whole);
  }
  for (int i = 0; i < M; i++) y[i] = all[i];
}

/* Test whether y lies in the cell, to 1e-9 of a width, and to 1e-6 m or rad in a coordinate of width 0. */
SHARED int holds(const Arm *arm, const Chart *chart, const double y[]) {
  (void)arm;
  for (int i = 0; i < M; i++)
    if (!(fabs(y[i] - chart->center[i]) <= chart->bounds[i])) return 0;
  return 1;
}

SHARED int in_cell(const Arm *arm, const Chart *chart, const double p[3], const double R[9]) {
  double y[M];
  Pose x;
  for (int i = 0; i < 3; i++) x.p[i] = p[i];
  for (int i = 0; i < 9; i++) x.R[i] = R[i];
  cell_coordinates(arm, chart, &x, y);
  return holds(arm, chart, y);
}

/* ---- rates and placements at given coordinates ---- */

/* Coefficients of the left Jacobian of SO(3), J_l(w) = I + a w^ + b w^ w^, by the square of |w|. */
static void left_jacobian(double square, double *a, double *b) {
  const double angle = sqrt(square);
  *a = angle < 1e-4 ? 0.5 - square / 24.0 : (1.0 - cos(angle)) / square;
  *b = angle < 1e-4 ? 1.0 / 6.0 - square / 120.0 : (angle - sin(angle)) / (square * angle);
}

/* J_l(w) x. */
static void angular(const double w[3], const double x[3], double y[3]) {
  double s[3], t[3], a, b;
  left_jacobian(w[0] * w[0] + w[1] * w[1] + w[2] * w[2], &a, &b);
  s[0] = w[1] * x[2] - w[2] * x[1], s[1] = w[2] * x[0] - w[0] * x[2], s[2] = w[0] * x[1] - w[1] * x[0];
  t[0] = w[1] * s[2] - w[2] * s[1], t[1] = w[2] * s[0] - w[0] * s[2], t[2] = w[0] * s[1] - w[1] * s[0];
  for (int i = 0; i < 3; i++) y[i] = x[i] + a * s[i] + b * t[i];
}

/* exp(w^) x, with exp(w^) = I + sin|w| / |w| w^ + a w^ w^. */
static void rotated(const double w[3], const double x[3], double y[3]) {
  double s[3], t[3], a, b;
  const double square = w[0] * w[0] + w[1] * w[1] + w[2] * w[2];
  left_jacobian(square, &a, &b);
  s[0] = w[1] * x[2] - w[2] * x[1], s[1] = w[2] * x[0] - w[0] * x[2], s[2] = w[0] * x[1] - w[1] * x[0];
  t[0] = w[1] * s[2] - w[2] * s[1], t[1] = w[2] * s[0] - w[0] * s[2], t[2] = w[0] * s[1] - w[1] * s[0];
  for (int i = 0; i < 3; i++) y[i] = x[i] + (1.0 - square * b) * s[i] + a * t[i];
}

/* Rotation vector, base axes, of the angular coordinates of a box. */
static void box_vector(const Arm *arm, const Chart *chart, const double y[], double w[3]) {
  const double *R = chart->R;
  for (int i = 0; i < 3; i++)
    w[i] = arm->kind == POSE ? y[3 + i] : arm->kind == AXIS ? R[3 * i] * y[3] + R[3 * i + 1] * y[4] : 0.0;
}

/* A sector's R_a(angle) x; R_a(angle) R_0 x if x is in axes of the middle's frame. */
static void around(const Chart *chart, const double *B, double angle, const double x[3], double y[3]) {
  const double c = cos(angle), s = sin(angle);
  double v[3], w[3];
  turned(B, x, v);
  w[0] = c * v[0] - s * v[1], w[1] = s * v[0] + c * v[1], w[2] = v[2];
  turned_back(chart->basis, w, y);
}

/* Convert a gradient d by the two angular coordinates of an axis task, with the rates A of the frame's own x and y
   per unit of each, to one by these two rates. */
static void solve_two(double A[2][3], double first, double second, double d[2]) {
  const double det = A[0][0] * A[1][1] - A[0][1] * A[1][0];
  d[0] = (first * A[1][1] - second * A[0][1]) / det;
  d[1] = (second * A[0][0] - first * A[1][0]) / det;
}

/* d <- d E^-1: convert a gradient by y to one by the task coordinates; E is the task velocity per unit of y. */
static void box_rates(const Arm *arm, const Chart *chart, const double R[9], const double y[], double d[]) {
  if (arm->kind == POSE) {
    const double *w = y + 3, square = w[0] * w[0] + w[1] * w[1] + w[2] * w[2], angle = sqrt(square);
    const double c = angle < 1e-3 ? 1.0 / 12.0 + square / 720.0
                                  : 1.0 / square - (1.0 + cos(angle)) / (2.0 * angle * sin(angle));
    const double r[3] = {d[3], d[4], d[5]};
    const double s[3] = {r[1] * w[2] - r[2] * w[1], r[2] * w[0] - r[0] * w[2], r[0] * w[1] - r[1] * w[0]};
    d[3] = r[0] - s[0] / 2.0 + c * (s[1] * w[2] - s[2] * w[1]);
    d[4] = r[1] - s[1] / 2.0 + c * (s[2] * w[0] - s[0] * w[2]);
    d[5] = r[2] - s[2] / 2.0 + c * (s[0] * w[1] - s[1] * w[0]);
  } else if (arm->kind == AXIS) {
    const double *R_0 = chart->R;
    double w[3], A[2][3];
    box_vector(arm, chart, y, w);
    for (int k = 0; k < 2; k++) {
      const double x[3] = {R_0[k], R_0[3 + k], R_0[6 + k]};
      double turn[3];
      angular(w, x, turn);
      turned_back(R, turn, A[k]);
    }
    solve_two(A, d[3], d[4], d + 3);
  }
}

static void sector_rates(const Arm *arm, const Chart *chart, const double R[9], const double y[], double d[]) {
  const double *B = chart->basis, c = cos(y[1]), s = sin(y[1]);
  double all[6] = {0.0}, A[2][3], g[3] = {0.0}, v[3], round_about, side[2], slope[2], radius;
  sides_at(chart, M > 2 ? y[2] : 0.0, side, slope);
  radius = chart->radius + side[0] + side[1] * y[0];
  for (int i = 0; i < M; i++) all[i] = d[i];
  all[0] /= side[1];
  all[2] -= (slope[0] + slope[1] * y[0]) * all[0];
  round_about = all[1];
  if (M > 3) { /* A: the frame's own angular velocity per tilt */
    const double t[3] = {y[3], y[4], 0.0};
    for (int k = 0; k < 2; k++) {
      double unit[3] = {0.0}, turn[3], base[3];
      unit[k] = 1.0;
      angular(t, unit, turn);
      around(chart, chart->turn, y[1], turn, base);
      turned_back(R, base, A[k]);
    }
    g[2] = all[5];
    solve_two(A, all[3] - A[0][2] * g[2], all[4] - A[1][2] * g[2], g);
    for (int i = 0; i < 3; i++) round_about -= (R[i] * B[6] + R[3 + i] * B[7] + R[6 + i] * B[8]) * g[i];
  }
  for (int i = 0; i < 3; i++)
    v[i] = all[0] * (c * B[i] + s * B[3 + i]) + round_about / radius * (c * B[3 + i] - s * B[i]) + all[2] * B[6 + i];
  for (int i = 0; i < M && i < 3; i++) d[i] = v[arm->kind == POSITION ? arm->rows[i] : i];
  if (arm->kind == POSE) turned(R, g, d + 3);
  if (arm->kind == AXIS) d[3] = g[0], d[4] = g[1];
}

SHARED void cell_rates(const Arm *arm, const Chart *chart, const double R[9], const double y[], double d[]) {
  if (chart->sector)
    sector_rates(arm, chart, R, y, d);
  else
    box_rates(arm, chart, R, y, d);
}

/* The placement at coordinates y, 0 in those that the task does not have. */
SHARED void cell_place(const Arm *arm, const Chart *chart, const double y[6], Pose *x) {
  const double *R_0 = chart->R, *B = chart->basis;
  double w[3];
  if (!chart->sector) {
    for (int i = 0; i < 3; i++) x->p[i] = chart->p[i];
    for (int i = 0; i < M && i < 3; i++) x->p[arm->kind == POSITION ? arm->rows[i] : i] += y[i];
    box_vector(arm, chart, y, w);
  } else {
    double side[2], slope[2], radius, at[3];
    sides_at(chart, y[2], side, slope);
    radius = chart->radius + side[0] + side[1] * y[0];
    at[0] = radius * cos(y[1]), at[1] = radius * sin(y[1]), at[2] = chart->height + y[2];
    turned_back(B, at, x->p);
    for (int i = 0; i < 3; i++) x->p[i] += chart->origin[i];
    w[0] = y[3], w[1] = y[4], w[2] = 0.0;
  }
  for (int k = 0; k < 3; k++) { /* column by column */
    const double c = cos(y[5]), s = sin(y[5]), spun[9] = {c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0};
    const double *from = chart->sector ? spun : R_0, column[3] = {from[k], from[3 + k], from[6 + k]};
    double turn[3], base[3];
    rotated(w, column, turn);
    if (chart->sector) around(chart, chart->turn, y[1], turn, base);
    for (int i = 0; i < 3; i++) x->R[3 * i + k] = chart->sector ? base[i] : turn[i];
  }
}

/* The twist of the frame per unit of coordinate b, at coordinates y. */
SHARED void cell_twist(const Arm *arm, const Chart *chart, const double y[6], int b, double twist[6]) {
  const double *B = chart->basis, c = cos(y[1]), s = sin(y[1]);
  double unit[6] = {0.0}, w[3], axis[3], side[2], slope[2];
  for (int i = 0; i < 6; i++) twist[i] = 0.0;
  unit[b] = 1.0;
  if (!chart->sector) {
    if (b < 3 && b < M) twist[arm->kind == POSITION ? arm->rows[b] : b] = 1.0;
    box_vector(arm, chart, y, w);
    box_vector(arm, chart, unit, axis);
    angular(w, axis, twist + 3);
    return;
  }
  sides_at(chart, y[2], side, slope);
  for (int i = 0; i < 3; i++) {
    const double radial = c * B[i] + s * B[3 + i], radius = chart->radius + side[0] + side[1] * y[0];
    if (b == 0) twist[i] = side[1] * radial;
    if (b == 1) twist[i] = radius * (c * B[3 + i] - s * B[i]);
    if (b == 1) twist[3 + i] = B[6 + i];
    if (b == 2) twist[i] = B[6 + i] + (slope[0] + slope[1] * y[0]) * radial;
  }
  if (b > 2) {
    const double t[3] = {y[3], y[4], 0.0};
    if (b < 5)
      angular(t, unit + 3, w);
    else
      rotated(t, unit + 3, w); /* the tool's z axis */
    around(chart, chart->turn, y[1], w, twist + 3);
  }
}

/* ---- the chart ---- */

#include "chart_polynomials.h" /* of one pose */

/* u (k) of y, and what the symmetries add to q_ref. */
SHARED void scaled_coordinates(const Arm *arm, const Chart *chart, const double y[], double u[], double shift[]) {
  (void)arm;
  for (int k = 0; k < chart->k; k++) u[k] = (y[chart->moved[k]] - chart->center[chart->moved[k]]) * chart->scale[k];
  for (int i = 0; i < N; i++) shift[i] = 0.0;
  for (int l = 0; l < chart->removed; l++) shift[chart->joint[l]] = chart->sign[l] * y[chart->coordinate[l]];
}

/* Add h_j = n_j^T (q - q_ref) to h, and its gradient V_j = n_j + (dh_j/du) (du/dx) J. */
SHARED void add_cell_potentials(const Arm *arm, const Chart *chart, const double q[], const double p[3],
                                const double R[9], double J[][N], double h[], double V[][N]) {
  const double whole = 6.283185307179586;
  double y[6], u[6] = {0.0}, T[CHART_TERMS], both[WIDE], shift[N], away[N], bar[CHART_TERMS];
  Pose x;
  for (int i = 0; i < 3; i++) x.p[i] = p[i];
  for (int i = 0; i < 9; i++) x.R[i] = R[i];
  cell_coordinates(arm, chart, &x, y);
  scaled_coordinates(arm, chart, y, u, shift);
  monomials_of_one(chart, u, T);
  references_of_one(arm, chart, T, both);
  for (int i = 0; i < N; i++) away[i] = q[i] - both[i] - shift[i];
  for (int l = 0; l < chart->removed; l++) { /* to within half a turn */
    double *angle = away + chart->joint[l];
    *angle -= whole * rint(*angle / whole);
  }
  for (int j = 0; j < N - M; j++) {
    const double *w = chart->weights;
    double d[6] = {0.0};
    for (int i = 0; i < N; i++) h[j] += both[Q_WIDE + j * N + i] * away[i];
    for (int a = 0; a < chart->terms; a++) { /* h_j = sum bar_a T_a at this n_j and this q - q_ref */
      bar[a] = 0.0;
      for (int i = 0; i < N; i++) bar[a] -= both[Q_WIDE + j * N + i] * w[i];
      if (a < chart->both)
        for (int i = 0; i < N; i++) bar[a] += w[Q_WIDE + j * N + i] * away[i];
      w += a < chart->both ? WIDE : Q_WIDE;
    }
    for (int a = chart->terms - 1; a > 0; a--) { /* the chain rule, from T_a = T_parent u_factor */
      const int parent = chart->parent[a], factor = chart->factor[a];
      d[chart->moved[factor]] += bar[a] * T[parent] * chart->scale[factor];
      bar[parent] += bar[a] * u[factor];
    }
    for (int l = 0; l < chart->removed; l++)
      d[chart->coordinate[l]] -= chart->sign[l] * both[Q_WIDE + j * N + chart->joint[l]];
    cell_rates(arm, chart, R, y, d);
    for (int i = 0; i < N; i++) {
      V[j][i] += both[Q_WIDE + j * N + i];
      for (int a = 0; a < M; a++) V[j][i] += d[a] * J[a][i];
    }
  }
}
