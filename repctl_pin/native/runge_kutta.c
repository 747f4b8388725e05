/* Runge-Kutta steps of two control laws along twists that are the same in every cycle.

   Without potentials:  qdot = z + J^T (J J^T)^-1 (xdot - J z),  z = gain (posture - q),
   as in strategies/pseudoinverse.py. With potentials:  [J; V^T] qdot = [xdot; 0],  as in
   strategies/control_step.py. Both stop before a step that needs the exact tests of these files. */

#include <math.h>
#include <string.h>

#include "arm.h"
#include "chain.h"

typedef struct {
  const Arm *arm;
  int stages, steps;               /* of the method, of a cycle */
  int r, degree;                   /* potentials, 0 without; degree of their tensor */
  double gain, sufficient;         /* of the posture; the law's sufficient test of its rank */
  const double *posture;           /* n */
  const double *tensor, *center;   /* r (n+1)^degree, n: V_i = tensor[z, ..., z], z = (1, q - center) */
  const double *nodes, *weights;   /* stages: c and b of the tableau */
  const double *xdot, *h, *most;   /* steps stages m, steps, n: of each stage, s, rad or m per step */
} Law;

static int least_speed(const Law *law, const double *q, const double *xdot, double *qdot) {
  int n = law->arm->n, m = law->arm->m;
  double p[3], R[9], J[m * n], L[m * m], y[m], z[n], squares = 1, pivots = 1;
  place(law->arm, q, p, R, (double(*)[n])J);
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
  int n = law->arm->n, w = n + 1, size = law->r;
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
  for (int i = 0; i < law->r; i++) memcpy(V_T + i * n, from + i * w + 1, n * sizeof(double));
}

static int on_leaf(const Law *law, const double *q, const double *xdot, double *x) {
  int n = law->arm->n, m = law->arm->m;
  double p[3], R[9], A[n * n], square = 0;
  place(law->arm, q, p, R, (double(*)[n])A);
  gradients(law, q, A + m * n);
  for (int i = 0; i < n; i++) x[i] = i < m ? xdot[i] : 0, square += x[i] * x[i];
  for (int i = 0; i < n * n; i++) square += A[i] * A[i];
  double pivots = eliminate(n, A, x);
  if (!(square < INFINITY && fabs(pivots) > law->sufficient * pow(square, n / 2.0))) return 0;
  substitute(n, A, x);
  return 1;
}

/* Step from row `step` of Q on; return the first step that is not done. */
EXPORT int runge_kutta_steps(const Law *law, int step, int end, double *Q, double *Qdot) {
  int n = law->arm->n, m = law->arm->m, stages = law->stages;
  double slopes[stages][n], at[n];
  for (; step < end; step++) {
    const double *q = Q + (long)step * n, *xdot = law->xdot + (long)(step % law->steps) * stages * m;
    double *next = Q + (long)(step + 1) * n, h = law->h[step % law->steps];
    for (int i = 0; i < stages; i++) {
      for (int k = 0; k < n; k++) at[k] = i ? q[k] + h * law->nodes[i] * slopes[i - 1][k] : q[k];
      if (!(law->r ? on_leaf : least_speed)(law, at, xdot + i * m, slopes[i])) return step;
    }
    for (int k = 0; k < n; k++) {
      double sum = 0;
      for (int i = 0; i < stages; i++) sum += law->weights[i] * slopes[i][k];
      next[k] = q[k] + h * sum;
      if (!(fabs(next[k] - q[k]) < law->most[k])) return step;
    }
    memcpy(Qdot + (long)step * n, slopes[0], sizeof slopes[0]);
  }
  return step;
}
