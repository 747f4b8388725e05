/* Doors for tests to what is static in the kernels of proofs: one operation on Taylor models of one box, the bound of
   two solutions, and the models of a cell's poses. */

#include "cell_bounds.c"

static void load(const Space *g, const double *from, Model *x) {
  for (int m = 0; m < g->M; m++) x->p[m] = all(from[m]);
  x->r = all(from[g->M]);
  finish(g, x);
}

/* x and y are the M coefficients of a model, and its bound; there are up to four results. */
EXPORT void operate(const Space *g, int what, double s, const double *x, const double *y, double *out) {
  Model a, b, c[4];
  load(g, x, &a), load(g, y, &b);
  switch (what) {
    case 0: add(g, &a, s, &b, c); break;
    case 1: product(g, &a, &b, c); break;
    case 2: sine_cosine(g, &a, c, c + 1); break;
    case 3: exponential(g, &a, c); break;
    case 4: power_model(g, &a, s, c); break;
    case 5: copy(g, &a, c), scale(g, s, c); break;
    default: sum_of(g, (double[3]){2, -1, s}, &a, &b, &a, c);
  }
  for (int i = 0; i < (what == 2 ? 2 : what == 3 ? 4 : 1); i++) {
    for (int m = 0; m < g->M; m++) out[i * (g->M + 1) + m] = c[i].p[m][0];
    out[i * (g->M + 1) + g->M] = c[i].r[0];
  }
}

EXPORT int two_solutions(const Cell *s, const double *norms, const double *steps, double *D) {
  return commutator(s, norms, steps, D);
}

/* The pose on one box u +- h, (k,) each: p, the columns of R, and the m twists, of M coefficients and a bound each. */
EXPORT void poses(const Cell *s, const double *u, const double *h, double *out) {
  const Space *g = &s->space;
  Lanes at[6], half[6];
  Model p[3], R[3][3], twists[6][6];
  const Model *parts[3] = {p, R[0], twists[0]};
  const int counts[3] = {3, 9, 6 * s->m};
  for (int a = 0; a < g->k; a++) at[a] = all(u[a]), half[a] = all(h[a]);
  pose_models(s, at, half, p, R, twists);
  for (int part = 0; part < 3; part++)
    for (int i = 0; i < counts[part]; i++) {
      for (int m = 0; m < g->M; m++) *out++ = parts[part][i].p[m][0];
      *out++ = parts[part][i].r[0];
    }
}
