/* Kinematics of a serial chain, and Newton's method on f(q) = x, n_ref^T (q - q_ref) = s, at many poses.

   The same mathematics as kinematics.py and chart.py, one pose at a time. */

#include <math.h>

enum { MOST = 32 }; /* joints */

typedef struct {
  int P, n, m, kind;                /* joints of the model and of the task; kind 0 pose, 1 tool axis, 2 position */
  const int *revolute, *rows;       /* P, m: coordinates of the position */
  const double *R, *p, *axis;       /* P + 1 9, P + 1 3, P 3: placements after each joint, the frame's last */
  const double *S, *offset;         /* P n, P: joints of the model = S q + offset */
} Chain;

static void times(const double *A, const double *B, double *C) {
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) C[3 * i + j] = A[3 * i] * B[j] + A[3 * i + 1] * B[3 + j] + A[3 * i + 2] * B[6 + j];
}

static void add_turned(const double *R, const double *x, double *y) {
  for (int i = 0; i < 3; i++) y[i] += R[3 * i] * x[0] + R[3 * i + 1] * x[1] + R[3 * i + 2] * x[2];
}

static void turn(const double *a, double angle, double *E) { /* Rodrigues */
  const double s = sin(angle), c = cos(angle), x = a[0], y = a[1], z = a[2], d = 1 - c;
  E[0] = c + d * x * x, E[1] = d * x * y - s * z, E[2] = d * x * z + s * y;
  E[3] = d * y * x + s * z, E[4] = c + d * y * y, E[5] = d * y * z - s * x;
  E[6] = d * z * x - s * y, E[7] = d * z * y + s * x, E[8] = c + d * z * z;
}

/* Position, rotation, and J (m, n) in A, at q. */
static void place(const Chain *chain, const double *q, double *p, double *R, double *A) {
  double next[9], E[9], z[MOST][3], o[MOST][3];
  const int n = chain->n, m = chain->m;
  for (int i = 0; i < 9; i++) R[i] = i % 4 == 0;
  for (int i = 0; i < 3; i++) p[i] = 0;
  for (int j = 0; j <= chain->P; j++) {
    double angle = 0;
    add_turned(R, chain->p + 3 * j, p);
    times(R, chain->R + 9 * j, next);
    for (int i = 0; i < 9; i++) R[i] = next[i];
    if (j == chain->P) break;
    for (int i = 0; i < n; i++) angle += chain->S[j * n + i] * q[i];
    angle += chain->offset[j];
    for (int i = 0; i < 3; i++) z[j][i] = 0, o[j][i] = p[i];
    add_turned(R, chain->axis + 3 * j, z[j]);
    if (chain->revolute[j]) {
      turn(chain->axis + 3 * j, angle, E);
      times(R, E, next);
      for (int i = 0; i < 9; i++) R[i] = next[i];
    } else
      for (int i = 0; i < 3; i++) p[i] += angle * z[j][i];
  }
  for (int i = 0; i < m * n; i++) A[i] = 0;
  for (int j = 0; j < chain->P; j++) {
    const double *a = z[j], d[3] = {p[0] - o[j][0], p[1] - o[j][1], p[2] - o[j][2]};
    double t[6] = {a[0], a[1], a[2], 0, 0, 0}, column[6];
    if (chain->revolute[j]) {
      t[0] = a[1] * d[2] - a[2] * d[1], t[1] = a[2] * d[0] - a[0] * d[2], t[2] = a[0] * d[1] - a[1] * d[0];
      t[3] = a[0], t[4] = a[1], t[5] = a[2];
    }
    for (int i = 0; i < m; i++)
      column[i] = chain->kind == 2 ? t[chain->rows[i]]
                  : chain->kind == 0 || i < 3 ? t[i]
                                              : R[i - 3] * t[3] + R[i] * t[4] + R[i + 3] * t[5];
    for (int i = 0; i < n; i++) {
      const double share = chain->S[j * n + i];
      if (share != 0)
        for (int k = 0; k < m; k++) A[k * n + i] += share * column[k];
    }
  }
}

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

/* x <- A^-1 x by elimination with exchanges; 0 if A is singular. */
static int solve(int n, double *A, double *x) {
  for (int k = 0; k < n; k++) {
    int best = k;
    for (int i = k + 1; i < n; i++)
      if (fabs(A[i * n + k]) > fabs(A[best * n + k])) best = i;
    if (!(fabs(A[best * n + k]) > 0)) return 0;
    if (best != k) {
      const double a = x[k];
      x[k] = x[best], x[best] = a;
      for (int j = k; j < n; j++) {
        const double b = A[k * n + j];
        A[k * n + j] = A[best * n + j], A[best * n + j] = b;
      }
    }
    for (int i = k + 1; i < n; i++) {
      const double l = A[i * n + k] / A[k * n + k];
      for (int j = k + 1; j < n; j++) A[i * n + j] -= l * A[k * n + j];
      x[i] -= l * x[k];
    }
  }
  for (int k = n - 1; k >= 0; k--) {
    for (int j = k + 1; j < n; j++) x[k] -= A[k * n + j] * x[j];
    x[k] /= A[k * n + k];
  }
  return 1;
}

void chart_place(const Chain *chain, long K, const double *Q, double *p, double *R, double *J) {
  const int n = chain->n, m = chain->m;
  for (long a = 0; a < K; a++) place(chain, Q + a * n, p + 3 * a, R + 9 * a, J + a * m * n);
}

/* Newton's method at every row of Q (K, n), with steps of at most longest; then p, R, J and e there. */
void chart_solve(const Chain *chain, long K, const double *p_goal, const double *R_goal, const double *q_ref,
                 const double *n_ref, const double *s, int iterations, double longest, double tolerance, double *Q,
                 double *R, double *J, double *residual, double *size) {
  const int n = chain->n, m = chain->m, r = n - m;
  double A[MOST * MOST], b[MOST], p[3];
  for (long a = 0; a < K; a++) {
    double *q = Q + a * n, *R_a = R + 9 * a;
    size[a] = HUGE_VAL;
    for (int turn = 0; turn < iterations; turn++) {
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
      if (!solve(n, A, b)) break;
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
