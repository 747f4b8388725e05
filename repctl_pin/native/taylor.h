/* Taylor models (Makino and Berz): polynomials P of degree 3 in k variables with a bound r of their remainder, on LANES boxes
   at a time: |f(u_c + h t) - P(t)| <= r for all t in [-1, 1]^k. r includes rounding: the error of a sum of up to M products is
   less than (M + 2) u times the sum of absolute values, u = 2^-53, and ROUND is several times that. */

#include <math.h>
#include <stdlib.h>

#include "vector_levels.h"

/* As many lanes as a register holds; clang splits wide vectors well, gcc does not. */
#if defined(__clang__) || defined(__AVX512F__)
#define LANES 8
#elif defined(__AVX2__)
#define LANES 4
#else
#define LANES 2
#endif
#ifndef MOST
#define MOST 84 /* monomials of six variables */
#endif
#define ROUND 2e-14

typedef double Lanes __attribute__((vector_size(8 * LANES), aligned(8)));
typedef long long Bits __attribute__((vector_size(8 * LANES), aligned(8)));

typedef struct {
  int k, M;
  const int *left, *right, *first, *starts; /* products, products, M + 1, 5 */
} Space;

typedef struct {
  Lanes p[MOST], r, n[4]; /* coefficients, bound of the rest, sums of absolute values of each degree */
} Model;

static inline Lanes all(double x) { return (Lanes){0} + x; }

static inline Lanes absolute(Lanes x) { return (Lanes)((Bits)x & 0x7fffffffffffffffLL); }

static inline Lanes largest(Lanes x, double least) {
  for (int l = 0; l < LANES; l++) x[l] = fmax(x[l], least);
  return x;
}

static inline Lanes root(Lanes x) {
  for (int l = 0; l < LANES; l++) x[l] = sqrt(x[l]);
  return x;
}

static inline Lanes size_of(const Model *x) { return x->n[0] + x->n[1] + x->n[2] + x->n[3]; }

static inline Lanes most_of(const Model *x) { return (size_of(x) + x->r) * (1 + ROUND); }

static void finish(const Space *g, Model *x) {
  for (int d = 0; d < 4; d++) {
    Lanes s = all(0);
    for (int m = g->starts[d]; m < g->starts[d + 1]; m++) s += absolute(x->p[m]);
    x->n[d] = s;
  }
}

/* What is beyond the M coefficients of these models is never read. */
static void copy(const Space *g, const Model *x, Model *out) {
  for (int m = 0; m < g->M; m++) out->p[m] = x->p[m];
  for (int d = 0; d < 4; d++) out->n[d] = x->n[d];
  out->r = x->r;
}

static void copy_vector(const Space *g, const Model *x, Model *out) {
  for (int i = 0; i < 3; i++) copy(g, x + i, out + i);
}

static void constant(const Space *g, double value, Model *x) {
  for (int m = 1; m < g->M; m++) x->p[m] = all(0);
  x->p[0] = all(value), x->r = x->n[1] = x->n[2] = x->n[3] = all(0);
  x->n[0] = all(fabs(value));
}

static const double NO_VECTOR[3] = {0};

static void constants(const Space *g, const double *a, Model *out) {
  for (int i = 0; i < 3; i++) constant(g, a[i], out + i);
}

/* a x + b y */
static void add_scaled(const Space *g, double a, const Model *x, double b, const Model *y, Model *out) {
  Lanes r = fabs(a) * x->r + fabs(b) * y->r;
  r = r * (1 + ROUND) + ROUND * (fabs(a) * size_of(x) + fabs(b) * size_of(y));
  for (int m = 0; m < g->M; m++) out->p[m] = a * x->p[m] + b * y->p[m];
  out->r = r;
  finish(g, out);
}

/* x + b y */
static void add(const Space *g, const Model *x, double b, const Model *y, Model *out) {
  add_scaled(g, 1, x, b, y, out);
}

static void add_vectors(const Space *g, const Model *x, double b, const Model *y, Model *out) {
  for (int i = 0; i < 3; i++) add(g, x + i, b, y + i, out + i);
}

static void scale(const Space *g, double a, Model *x) { add_scaled(g, a, x, 0, x, x); }

/* a_0 x + a_1 y + a_2 z */
static void sum_of(const Space *g, const double *a, const Model *x, const Model *y, const Model *z, Model *out) {
  double b[3] = {fabs(a[0]), fabs(a[1]), fabs(a[2])};
  Lanes r = (b[0] * x->r + b[1] * y->r + b[2] * z->r) * (1 + ROUND);
  r += ROUND * (b[0] * size_of(x) + b[1] * size_of(y) + b[2] * size_of(z));
  for (int m = 0; m < g->M; m++) out->p[m] = a[0] * x->p[m] + a[1] * y->p[m] + a[2] * z->p[m];
  out->r = r;
  finish(g, out);
}

/* a' x for three models */
static void combine(const Space *g, const double *a, const Model *x, Model *out) {
  sum_of(g, a, x, x + 1, x + 2, out);
}

static void product(const Space *g, const Model *x, const Model *y, Model *out) {
  const Lanes *a = x->n, *b = y->n;
  Lanes one = size_of(x), two = size_of(y);
  Lanes r = a[1] * b[3] + a[2] * (b[2] + b[3]) + a[3] * (b[1] + b[2] + b[3]);
  r = (r + one * y->r + x->r * two + x->r * y->r + ROUND * one * two) * (1 + ROUND);
  for (int m = 0; m < g->M; m++) {
    Lanes s = all(0);
    for (int l = g->first[m]; l < g->first[m + 1]; l++) s += x->p[g->left[l]] * y->p[g->right[l]];
    out->p[m] = s;
  }
  out->r = r;
  finish(g, out);
}

/* out + b x y */
static void add_product(const Space *g, const Model *x, const Model *y, double b, Model *out) {
  Model both;
  product(g, x, y, &both), add(g, out, b, &both, out);
}

static void dot_models(const Space *g, const Model *x, const Model *y, Model *out) {
  product(g, x, y, out);
  for (int i = 1; i < 3; i++) add_product(g, x + i, y + i, 1, out);
}

/* Sum f_i d^i, d what x differs from its centre by, and fourth |d|^4. */
static void series(const Space *g, const Model *x, const Lanes *f, double fourth, double round, Model *out) {
  Model d, square, cube;
  copy(g, x, &d);
  d.p[0] = d.n[0] = all(0);
  product(g, &d, &d, &square), product(g, &square, &d, &cube);
  Lanes most = most_of(&d), r = fourth * most * most * most * most + round;
  const Model *parts[3] = {&d, &square, &cube};
  for (int i = 0; i < 3; i++) {
    Lanes a = absolute(f[1 + i]);
    r += a * parts[i]->r + 4 * ROUND * a * size_of(parts[i]);
  }
  for (int m = 0; m < g->M; m++) out->p[m] = f[1] * d.p[m] + f[2] * square.p[m] + f[3] * cube.p[m];
  out->p[0] = f[0], out->r = r * (1 + 4 * ROUND);
  finish(g, out);
}

static void sine_cosine(const Space *g, const Model *x, Model *sine, Model *cosine) {
  Lanes s, c;
  for (int l = 0; l < LANES; l++) s[l] = sin(x->p[0][l]), c[l] = cos(x->p[0][l]);
  Lanes f[4] = {s, c, -0.5 * s, -c / 6}, e[4] = {c, -s, -0.5 * c, s / 6};
  series(g, x, f, 1. / 24, ROUND, sine), series(g, x, e, 1. / 24, ROUND, cosine);
}

/* x^s for x > 0; r is infinite where x may be 0. */
static void power_model(const Space *g, const Model *x, double s, Model *out) {
  Lanes f[4], fourth, round, reach = (size_of(x) - x->n[0] + x->r) * (1 + ROUND);
  for (int l = 0; l < LANES; l++) {
    double c = x->p[0][l], least = (c - reach[l]) * (1 - ROUND);
    int sure = least > 0;
    double v = c > 0 ? pow(c, s) : 0;
    round[l] = sure ? ROUND * v : INFINITY;
    for (int i = 0; i < 4; i++) f[i][l] = v, v = c > 0 ? v * ((s - i) / ((i + 1) * c)) : 0;
    fourth[l] = sure ? fabs(s * (s - 1) * (s - 2) * (s - 3)) / 24 * pow(least, s - 4) : 0;
  }
  Lanes most = (x->n[1] + x->n[2] + x->n[3] + x->r) * (1 + ROUND);
  series(g, x, f, 0, 0, out);
  out->r += (fourth * most * most * most * most + round) * (1 + 8 * ROUND);
}

/* cos sqrt z, sin sqrt z / sqrt z, (1 - cos sqrt z) / z and (1 - sin sqrt z / sqrt z) / z at z from 0 to pi^2: sums of
   (-z)^i / (2 i + m)! */
static void exponential(const Space *g, const Model *z, Model *out) {
  Lanes x = largest(z->p[0], 0);
  double fourth = 1. / 40320;
  for (int m = 0; m < 4; m++) {
    Lanes f[4];
    for (int j = 0; j < 4; j++) {
      double term = j % 2 ? -1 : 1;
      for (int i = 2; i <= 2 * j + m; i++) term /= i;
      Lanes total = all(0), power = all(1);
      for (int i = j; i < 24; i++) { /* binomial(i, j) (-1)^i z^(i - j) / (2 i + m)! */
        total += term * power, power *= x;
        term *= -(i + 1.) / (i + 1 - j) / ((2. * i + m + 1) * (2. * i + m + 2));
      }
      f[j] = total;
    }
    series(g, z, f, fourth, 1e-12, out + m);
    fourth /= 9 + m;
  }
}

/* Turn the columns x and y in their plane. */
static void plane(const Space *g, const Model *sine, const Model *cosine, Model *x, Model *y) {
  Model a, b, c, d;
  product(g, cosine, x, &a), product(g, sine, y, &b), product(g, cosine, y, &c), product(g, sine, x, &d);
  add(g, &a, 1, &b, x), add(g, &c, -1, &d, y);
}

static void cross_models(const Space *g, const Model *a, const Model *b, Model *out) {
  for (int i = 0; i < 3; i++) {
    int j = (i + 1) % 3, l = (i + 2) % 3;
    product(g, a + j, b + l, out + i), add_product(g, a + l, b + j, -1, out + i);
  }
}

/* a x x for constant a */
static void cross_constant(const Space *g, const double *a, const Model *x, Model *out) {
  const double hat[9] = {0, -a[2], a[1], a[2], 0, -a[0], -a[1], a[0], 0};
  for (int i = 0; i < 3; i++) combine(g, hat + 3 * i, x, out + i);
}

static void identity_models(const Space *g, Model (*R)[3]) {
  for (int c = 0; c < 3; c++)
    for (int i = 0; i < 3; i++) constant(g, i == c, &R[c][i]);
}

/* R x for constant x; R by columns. */
static void combine_columns(const Space *g, Model (*R)[3], const double *x, Model *y) {
  for (int i = 0; i < 3; i++) sum_of(g, x, &R[0][i], &R[1][i], &R[2][i], y + i);
}

/* R <- R C, by columns. */
static void turn_frame(const Space *g, const double *C, int transposed, Model (*R)[3]) {
  Model new[3][3];
  for (int c = 0; c < 3; c++) {
    double x[3];
    for (int i = 0; i < 3; i++) x[i] = transposed ? C[3 * c + i] : C[3 * i + c];
    combine_columns(g, R, x, new[c]);
  }
  for (int c = 0; c < 3; c++) copy_vector(g, new[c], R[c]);
}

/* s x for a vector x */
static void times_model(const Space *g, const Model *s, const Model *x, Model *out) {
  for (int i = 0; i < 3; i++) product(g, s, x + i, out + i);
}

/* Turn R about the axis that is the third column of basis. */
static void turn_about(const Space *g, const double *basis, const Model *sine, const Model *cosine, Model (*R)[3]) {
  turn_frame(g, basis, 0, R);
  for (int i = 0; i < 3; i++) plane(g, sine, cosine, &R[0][i], &R[1][i]);
  turn_frame(g, basis, 1, R);
}
