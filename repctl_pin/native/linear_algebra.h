/* Rotations. Matrices are in rows. */

#ifndef REPCTL_LINEAR_ALGEBRA_H
#define REPCTL_LINEAR_ALGEBRA_H

#ifndef EXPORT
#define EXPORT __attribute__((visibility("default")))
#endif

enum { MOST_JOINTS = 64 }; /* of a chain */

static inline double dot(const double *x, const double *y) { return x[0] * y[0] + x[1] * y[1] + x[2] * y[2]; }

static inline void apply(const double *R, const double *x, double *y) {
  for (int i = 0; i < 3; i++) y[i] = R[3 * i] * x[0] + R[3 * i + 1] * x[1] + R[3 * i + 2] * x[2];
}

static inline void add_turned(const double *R, const double *x, double *y) {
  for (int i = 0; i < 3; i++) y[i] += R[3 * i] * x[0] + R[3 * i + 1] * x[1] + R[3 * i + 2] * x[2];
}

static inline void turn_back(const double *R, const double *x, double *y) {
  for (int i = 0; i < 3; i++) y[i] = R[i] * x[0] + R[3 + i] * x[1] + R[6 + i] * x[2];
}

static inline void cross(const double *a, const double *b, double *c) {
  c[0] = a[1] * b[2] - a[2] * b[1];
  c[1] = a[2] * b[0] - a[0] * b[2];
  c[2] = a[0] * b[1] - a[1] * b[0];
}

/* A B, or A B^T; the result may replace A. */
static inline void times(const double *A, const double *B, int transposed, double *C) {
  const int row = transposed ? 3 : 1, column = transposed ? 1 : 3;
  for (int i = 0; i < 3; i++) {
    const double x = A[3 * i], y = A[3 * i + 1], z = A[3 * i + 2];
    for (int j = 0; j < 3; j++) C[3 * i + j] = x * B[row * j] + y * B[row * j + column] + z * B[row * j + 2 * column];
  }
}

/* Rotation about the unit vector a by the angle of this sine and cosine. */
static inline void turn(const double *a, double s, double c, double *E) { /* Rodrigues */
  const double d = 1 - c, x = a[0], y = a[1], z = a[2];
  E[0] = c + d * x * x, E[1] = d * x * y - s * z, E[2] = d * x * z + s * y;
  E[3] = d * y * x + s * z, E[4] = c + d * y * y, E[5] = d * y * z - s * x;
  E[6] = d * z * x - s * y, E[7] = d * z * y + s * x, E[8] = c + d * z * z;
}

#endif
