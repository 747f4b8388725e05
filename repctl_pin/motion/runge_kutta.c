/* Runge-Kutta steps of two control laws along twists that are the same in every cycle.

   Without potentials:  qdot = z + J^T (J J^T)^-1 (xdot - J z),  z = gain (posture - q),
   as in strategies/pseudoinverse.py. With potentials:  [J; V^T] qdot = [xdot; 0],  as in
   strategies/control_step.py. Both stop before a step that needs the exact tests of these files. */

#include <math.h>
#include <string.h>

typedef struct {
  int P, n, m, stages, steps;      /* joints of the chain and of the task, coordinates, of a cycle */
  int r, degree;                   /* potentials, 0 without; degree of their tensor */
  double gain, sufficient;         /* of the posture; the law's sufficient test of its rank */
  const double *R, *p, *a;         /* P+1 3 3, P+1 3, P 3: link placements, the last the frame's; axes */
  const int *revolute, *rows;      /* P, m: rows of the twist (v, omega) that are commanded */
  const double *S, *o;             /* P n, P: joints of the chain, theta = S q + o */
  const double *posture;           /* n */
  const double *tensor, *center;   /* r (n+1)^degree, n: V_i = tensor[z, ..., z], z = (1, q - center) */
  const double *nodes, *weights;   /* stages: c and b of the tableau */
  const double *xdot, *h, *most;   /* steps stages m, steps, n: of each stage, s, rad or m per step */
} Law;

static void times(const double *A, const double *B, double *C) {
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++)
      C[3 * i + j] = A[3 * i] * B[j] + A[3 * i + 1] * B[3 + j] + A[3 * i + 2] * B[6 + j];
}

static void add_turned(const double *A, const double *x, double *y) {
  for (int i = 0; i < 3; i++) y[i] += A[3 * i] * x[0] + A[3 * i + 1] * x[1] + A[3 * i + 2] * x[2];
}

static void turn(const double *a, double angle, double *E) { /* Rodrigues */
  double s = sin(angle), c = cos(angle), d = 1 - c, x = a[0], y = a[1], z = a[2];
  E[0] = c + d * x * x, E[1] = d * x * y - s * z, E[2] = d * x * z + s * y;
  E[3] = d * y * x + s * z, E[4] = c + d * y * y, E[5] = d * y * z - s * x;
  E[6] = d * z * x - s * y, E[7] = d * z * y + s * x, E[8] = c + d * z * z;
}

static void jacobian(const Law *law, const double *q, double *J) { /* m n, base axes */
  int P = law->P, n = law->n, m = law->m;
  double E[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, next[9], local[9], x[3] = {0, 0, 0};
  double axis[P][3], at[P][3];
  for (int j = 0; j < P; j++) {
    double theta = law->o[j];
    for (int k = 0; k < n; k++) theta += law->S[j * n + k] * q[k];
    add_turned(E, law->p + 3 * j, x);
    times(E, law->R + 9 * j, next);
    memset(axis[j], 0, sizeof axis[j]);
    add_turned(next, law->a + 3 * j, axis[j]);
    memcpy(at[j], x, sizeof x);
    if (law->revolute[j]) {
      turn(law->a + 3 * j, theta, local);
      times(next, local, E);
    } else {
      memcpy(E, next, sizeof E);
      for (int i = 0; i < 3; i++) x[i] += theta * axis[j][i];
    }
  }
  add_turned(E, law->p + 3 * P, x);
  memset(J, 0, sizeof(double) * m * n);
  for (int j = 0; j < P; j++) {
    double *w = axis[j], d[3] = {x[0] - at[j][0], x[1] - at[j][1], x[2] - at[j][2]};
    double xi[6] = {w[0], w[1], w[2], 0, 0, 0};
    if (law->revolute[j]) {
      xi[0] = w[1] * d[2] - w[2] * d[1], xi[1] = w[2] * d[0] - w[0] * d[2];
      xi[2] = w[0] * d[1] - w[1] * d[0];
      memcpy(xi + 3, w, 3 * sizeof(double));
    }
    for (int i = 0; i < m; i++)
      for (int k = 0; k < n; k++) J[i * n + k] += xi[law->rows[i]] * law->S[j * n + k];
  }
}

static int least_speed(const Law *law, const double *q, const double *xdot, double *qdot) {
  int n = law->n, m = law->m;
  double J[m * n], L[m * m], y[m], z[n], squares = 1, pivots = 1;
  jacobian(law, q, J);
  for (int k = 0; k < n; k++) z[k] = law->gain * (law->posture[k] - q[k]);
  for (int i = 0; i < m; i++) { /* J J^T = L L^T, and L y = xdot - J z */
    y[i] = xdot[i];
    for (int k = 0; k < n; k++) y[i] -= J[i * n + k] * z[k];
    for (int j = 0; j <= i; j++) {
      double sum = 0;
      for (int k = 0; k < n; k++) sum += J[i * n + k] * J[j * n + k];
      if (i == j) squares *= sum;
      for (int k = 0; k < j; k++) sum -= L[i * m + k] * L[j * m + k];
      if (i > j)
        L[i * m + j] = sum / L[j * m + j];
      else if (sum > 0)
        L[i * m + i] = sqrt(sum);
      else
        return 0;
    }
    for (int j = 0; j < i; j++) y[i] -= L[i * m + j] * y[j];
    y[i] /= L[i * m + i], pivots *= L[i * m + i];
  }
  if (!(pivots * pivots > law->sufficient * squares)) return 0;
  memcpy(qdot, z, sizeof z);
  for (int i = m - 1; i >= 0; i--) {
    for (int j = i + 1; j < m; j++) y[i] -= L[j * m + i] * y[j];
    y[i] /= L[i * m + i];
    for (int k = 0; k < n; k++) qdot[k] += y[i] * J[i * n + k];
  }
  return 1;
}

static void gradients(const Law *law, const double *q, double *V_T) { /* r n */
  int w = law->n + 1, size = law->r;
  double z[w];
  z[0] = 1;
  for (int k = 1; k < w; k++) z[k] = q[k - 1] - law->center[k - 1];
  for (int d = 1; d < law->degree; d++) size *= w;
  double part[size];
  const double *from = law->tensor;
  for (int d = 1; d < law->degree; d++, size /= w, from = part)
    for (int i = 0; i < size; i++) {
      double sum = 0;
      for (int k = 0; k < w; k++) sum += from[i * w + k] * z[k];
      part[i] = sum;
    }
  for (int i = 0; i < law->r; i++) memcpy(V_T + i * law->n, from + i * w + 1, law->n * sizeof(double));
}

static int on_leaf(const Law *law, const double *q, const double *xdot, double *x) {
  int n = law->n, m = law->m;
  double A[n * n], square = 0, pivots = 1;
  jacobian(law, q, A);
  gradients(law, q, A + m * n);
  for (int i = 0; i < n; i++) x[i] = i < m ? xdot[i] : 0, square += x[i] * x[i];
  for (int i = 0; i < n * n; i++) square += A[i] * A[i];
  for (int j = 0; j < n; j++) { /* Gauss, the largest pivot of each column */
    int best = j;
    for (int i = j + 1; i < n; i++)
      if (fabs(A[i * n + j]) > fabs(A[best * n + j])) best = i;
    for (int k = j; k < n && best != j; k++) {
      double a = A[j * n + k];
      A[j * n + k] = A[best * n + k], A[best * n + k] = a;
    }
    double b = x[j];
    x[j] = x[best], x[best] = b;
    pivots *= A[j * n + j];
    for (int i = j + 1; i < n; i++) {
      double f = A[i * n + j] / A[j * n + j];
      for (int k = j + 1; k < n; k++) A[i * n + k] -= f * A[j * n + k];
      x[i] -= f * x[j];
    }
  }
  if (!(square < INFINITY && fabs(pivots) > law->sufficient * pow(square, n / 2.0))) return 0;
  for (int i = n - 1; i >= 0; i--) {
    for (int k = i + 1; k < n; k++) x[i] -= A[i * n + k] * x[k];
    x[i] /= A[i * n + i];
  }
  return 1;
}

/* Step from row `step` of Q on; return the first step that is not done. */
int runge_kutta_steps(const Law *law, int step, int end, double *Q, double *Qdot) {
  int n = law->n, m = law->m, M = law->stages;
  double slopes[M][n], at[n];
  for (; step < end; step++) {
    const double *q = Q + (long)step * n, *xdot = law->xdot + (long)(step % law->steps) * M * m;
    double *next = Q + (long)(step + 1) * n, h = law->h[step % law->steps];
    for (int i = 0; i < M; i++) {
      for (int k = 0; k < n; k++) at[k] = i ? q[k] + h * law->nodes[i] * slopes[i - 1][k] : q[k];
      if (!(law->r ? on_leaf : least_speed)(law, at, xdot + i * m, slopes[i])) return step;
    }
    for (int k = 0; k < n; k++) {
      double sum = 0;
      for (int i = 0; i < M; i++) sum += law->weights[i] * slopes[i][k];
      next[k] = q[k] + h * sum;
      if (!(fabs(next[k] - q[k]) < law->most[k])) return step;
    }
    memcpy(Qdot + (long)step * n, slopes[0], sizeof slopes[0]);
  }
  return step;
}
