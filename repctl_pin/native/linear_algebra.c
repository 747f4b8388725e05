/* Linear equations. */

#include <math.h>

#include "linear_algebra.h"

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
