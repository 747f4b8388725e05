/* Linear equations of many small matrices. */

#include <math.h>

#include "linear_algebra.h"

/* Eliminate A x = b by rows, with the largest pivot of each column; b has p columns. Return 0 if a pivot is 0. */
static int eliminate(int n, int p, double *A, double *b) {
  int regular = 1;
  for (int j = 0; j < n; j++) {
    int best = j;
    for (int i = j + 1; i < n; i++)
      if (fabs(A[i * n + j]) > fabs(A[best * n + j])) best = i;
    for (int k = j; k < n && best != j; k++) {
      const double a = A[j * n + k];
      A[j * n + k] = A[best * n + k], A[best * n + k] = a;
    }
    for (int k = 0; k < p && best != j; k++) {
      const double x = b[j * p + k];
      b[j * p + k] = b[best * p + k], b[best * p + k] = x;
    }
    regular &= A[j * n + j] != 0;
    for (int i = j + 1; i < n; i++) {
      const double f = A[i * n + j] / A[j * n + j];
      for (int k = j + 1; k < n; k++) A[i * n + k] -= f * A[j * n + k];
      for (int k = 0; k < p; k++) b[i * p + k] -= f * b[j * p + k];
    }
  }
  return regular;
}

/* Solve what is left of A x = b, x in b. */
static void substitute(int n, int p, const double *A, double *b) {
  for (int i = n - 1; i >= 0; i--) {
    for (int j = i + 1; j < n; j++)
      for (int k = 0; k < p; k++) b[i * p + k] -= A[i * n + j] * b[j * p + k];
    for (int k = 0; k < p; k++) b[i * p + k] /= A[i * n + i];
  }
}

/* Solve A x = b of count matrices A (n, n) and b (n, p); A is overwritten, b becomes x, or NaN if A is singular. */
EXPORT void call_solutions(long count, int n, int p, double *A, double *b) {
  for (; count > 0; count--, A += n * n, b += n * p) {
    const int regular = eliminate(n, p, A, b);
    substitute(n, p, A, b);
    for (int i = 0; i < n * p && !regular; i++) b[i] = HUGE_VAL - HUGE_VAL;
  }
}
