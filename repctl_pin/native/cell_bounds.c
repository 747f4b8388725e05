/* A cell's function over boxes of poses: see docs/theory.md, "Proved, not sampled", "A cell".

   The same mathematics as cells.py, LANES boxes at a time where there are Taylor models, one box at a time elsewhere. */

#include "chain.h"
#include "leaf_margin_bounds.h"
#include "taylor.h"

typedef struct Cell {
  const Problem *chain;
  Space space;
  int w, terms, F, turning, angled, spun;  /* n (1 + r), monomials of the chart, and what moves the pose */
  int turned, slides;                      /* first column of R that the task controls, 3: none; base axes left free */
  double tool, columns;                    /* the tool's distance, the largest column of S */
  const int *parent, *variable, *used;     /* terms, terms, M: how many terms each derivative has */
  const int *fourth;                       /* F 4: variables of the products of degree 4 */
  const double *parts, *rest, *blur;       /* M terms w, F w, w: derivatives, fourth ones, rounding */
  const double *near, *lower, *upper;      /* n, n, n: d*, limits */
  const double *farthest;                  /* n: largest values of the joints */
  const double *o, *a, *d, *R0, *D, *Omega, *angle, *spin; /* 3, 3, 3, 3 3, 3 k, 3 k, k, k: the poses */
  const double *bases;                     /* P 3 3: rotations whose third columns are the axes */
  const double *tips;                      /* P: distances from the frame */
} Cell;

typedef struct Margins {
  double *leaf, *sigma, *limit, *Q, *reach;
  int *split;
} Margins;

static double norm3(const double *x) { return sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]); }

/* The leaf margin on a box where A J_V - I is known to first order in k variables of half-width 1: its slopes along, and
   the bound R of all else. The last columns of A belong to V. */
static int margin_of(const Problem *g, int k, double A[g->N][g->N], const double *R_, const double *along_,
                     double V[g->r][g->n], double dV[g->r][g->n][k], double rest[g->r][g->n], double beta, double *leaf,
                     double *sigma) {
  int n = g->n, N = g->N, r = g->r, split;
  const double(*R)[N] = (const double(*)[N])R_, (*along)[N][N] = (const double(*)[N][N])along_;
  double eps = g->eps, slack = 1 + eps, D[N][N], F[N][N], Y[N][N], DY[N][N], B[k][N][N], dN[k][N][r];
  double X[n][r], T[n][r], e[n][r], first[N][r], rough[N][r], h[k], share[k], round[6 + r], defect = eps, below;
  *leaf = *sigma = 0;
  for (int i = 0; i < 6 + r; i++) round[i] = 0;
  if (r > 1) turn_gauge(n, N, r, k, A, V, dV, rest, round);
  for (int i = 0; i < n; i++)
    for (int a = 0; a < r; a++) X[i][a] = A[i][6 + a], T[i][a] = X[i][a] - V[a][i];
  for (int a = 0; a < r; a++)
    for (int b = 0; b < r; b++) {
      double s = -(a == b), t = -(a == b);
      for (int i = 0; i < n; i++) s += V[a][i] * V[b][i], t += V[a][i] * X[i][b];
      defect += fabs(s) + fabs(t);
    }
  for (int i = 0; i < N; i++)
    for (int c = 0; c < N; c++) D[i][c] = R[i][c];
  for (int j = 0; j < k; j++) {
    h[j] = 1, share[j] = 0;
    for (int i = 0; i < N; i++) {
      for (int c = 0; c < N; c++) {
        double s = along[j][i][c];
        for (int a = 0; c < n && a < r; a++) s -= A[i][6 + a] * dV[a][c][j];
        B[j][i][c] = s, D[i][c] += fabs(s);
        if (i < n) share[j] += fabs(s);
      }
      for (int a = 0; a < r; a++) {
        double s = 0;
        for (int c = 0; c < N; c++) s -= B[j][i][c] * A[c][6 + a];
        dN[j][i][a] = s;
      }
    }
  }
  for (int i = 0; i < N; i++) {
    for (int a = 0; a < 6; a++) F[i][a] = fabs(A[i][a]) + eps;
    for (int a = 0; a < r; a++) {
      F[i][6 + a] = eps, first[i][a] = rough[i][a] = 0;
      for (int j = 0; j < k; j++) first[i][a] += fabs(dN[j][i][a]);
      for (int c = 0; c < N; c++) rough[i][a] += R[i][c] * fabs(A[c][6 + a]);
    }
  }
  for (int i = 0; i < N; i++)
    for (int a = 0; a < r; a++) {
      for (int j = 0; j < k; j++)
        for (int l = j; l < k; l++) {
          double s = 0;
          for (int c = 0; c < N; c++) s += B[j][i][c] * dN[l][c][a];
          for (int c = 0; l > j && c < N; c++) s += B[l][i][c] * dN[j][c][a];
          F[i][6 + a] += fabs(s);
        }
      for (int c = 0; c < N; c++) F[i][6 + a] += R[i][c] * first[c][a] + D[i][c] * rough[c][a];
    }
  if (!enclose(N, eps, D, F, Y, DY)) return 0;
  double square = 0;
  for (int i = 0; i < n; i++) {
    for (int j = 0; j < 6; j++) square += Y[i][j] * Y[i][j];
    for (int a = 0; a < r; a++) e[i][a] = rough[i][a] + Y[i][6 + a];
  }
  compare(g, k, h, X, T, V, dV, rest, defect, dN, first, e, share, spectral(n, r, &X[0][0], &below), leaf, &split);
  if (*leaf > 0) *sigma = (1 - eps) / (sqrt(square) * slack * beta);
  return *leaf > 0;
}

/* ---- Taylor models of the chart, the poses and the chain ---- */

/* cos sqrt z, sin sqrt z / sqrt z and (1 - cos sqrt z) / z at z from 0 to pi^2: sums of (-z)^i / (2 i + m)! */
static void exponential(const Space *g, const Model *z, Model *out) {
  Lanes x = largest(z->p[0], 0);
  double fourth = 1. / 40320;
  for (int m = 0; m < 3; m++) {
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

/* R x, R by columns */
static void apply_models(const Space *g, Model (*R)[3], const Model *x, Model *out) {
  Model y;
  for (int i = 0; i < 3; i++) {
    product(g, &R[0][i], x, out + i);
    for (int c = 1; c < 3; c++) product(g, &R[c][i], x + c, &y), add(g, out + i, 1, &y, out + i);
  }
}

/* q_ref and n_ref, (w,): expanded in t, u = u_c + h t. */
static void chart_models(const Cell *s, const Lanes *u, const Lanes *h, Model *out) {
  const Space *g = &s->space;
  Lanes T[s->terms], H[MOST];
  T[0] = H[0] = all(1);
  for (int t = 1; t < s->terms; t++) T[t] = T[s->parent[t]] * u[s->variable[t]];
  for (int m = 1; m < g->M; m++) H[m] = H[s->parent[m]] * h[s->variable[m]];
  for (int c = 0; c < s->w; c++) out[c].r = all(s->blur[c]);
  for (int m = 0; m < g->M; m++) {
    const double *C = s->parts + (long)m * s->terms * s->w;
    for (int c = 0; c < s->w; c++) {
      Lanes v = all(0);
      for (int t = 0; t < s->used[m]; t++) v += C[t * s->w + c] * T[t];
      out[c].p[m] = v * H[m];
    }
  }
  for (int f = 0; f < s->F; f++) {
    const int *i = s->fourth + 4 * f;
    Lanes v = h[i[0]] * h[i[1]] * h[i[2]] * h[i[3]] * (1 + 1e-12);
    for (int c = 0; c < s->w; c++) out[c].r += v * s->rest[f * s->w + c];
  }
  for (int c = 0; c < s->w; c++) finish(g, out + c);
}

static void linear_model(const Space *g, const double *row, const Lanes *u, const Lanes *h, Model *out) {
  constant(g, 0, out);
  for (int a = 0; a < g->k; a++) out->p[0] += row[a] * u[a], out->p[1 + a] = row[a] * h[a];
  finish(g, out);
  out->r = 1e-15 * (1 + size_of(out));
}

/* x + s a x x + (1 - c) a x (a x x): a vector turned about the axis. */
static void turn_model(const Cell *s, const Model *sine, const Model *cosine, Model *x) {
  const Space *g = &s->space;
  const double *a = s->a, hat[9] = {0, -a[2], a[1], a[2], 0, -a[0], -a[1], a[0], 0};
  double twice[9];
  Model y[3], z[3], e[2];
  times(hat, hat, 0, twice);
  for (int i = 0; i < 3; i++) combine(g, hat + 3 * i, x, y + i), combine(g, twice + 3 * i, x, z + i);
  for (int i = 0; i < 3; i++) {
    product(g, sine, y + i, e), product(g, cosine, z + i, e + 1);
    add(g, x + i, 1, e, x + i), add(g, x + i, 1, z + i, x + i), add(g, x + i, -1, e + 1, x + i);
  }
}

/* The place of the pose and its columns, from the base. */
static void pose_models(const Cell *s, const Lanes *u, const Lanes *h, Model *p, Model (*R)[3]) {
  const Space *g = &s->space;
  Model sine, cosine, angle, e, f;
  for (int i = 0; i < 3; i++) {
    linear_model(g, s->D + i * g->k, u, h, p + i);
    constant(g, s->d[i], &e), add(g, p + i, 1, &e, p + i);
    for (int c = 0; c < 3; c++) constant(g, s->R0[3 * i + c], &R[c][i]);
  }
  if (s->turning) { /* (c + s w^ + d w w') R0 */
    Model omega[3], z, c[3], turned[3], along;
    constant(g, 0, &z);
    for (int i = 0; i < 3; i++) {
      linear_model(g, s->Omega + i * g->k, u, h, omega + i);
      product(g, omega + i, omega + i, &e), add(g, &z, 1, &e, &z);
    }
    exponential(g, &z, c);
    for (int i = 0; i < 3; i++) {
      double b[3] = {s->R0[i], s->R0[3 + i], s->R0[6 + i]};
      double hat[9] = {0, b[2], -b[1], -b[2], 0, b[0], b[1], -b[0], 0}; /* w -> w x b */
      combine(g, b, omega, &along);
      for (int l = 0; l < 3; l++) {
        product(g, c, &R[i][l], turned + l);
        combine(g, hat + 3 * l, omega, &e), product(g, c + 1, &e, &f), add(g, turned + l, 1, &f, turned + l);
        product(g, &along, omega + l, &e), product(g, c + 2, &e, &f), add(g, turned + l, 1, &f, turned + l);
      }
      for (int l = 0; l < 3; l++) copy(g, turned + l, &R[i][l]);
    }
  }
  if (s->spun) {
    linear_model(g, s->spin, u, h, &angle), sine_cosine(g, &angle, &sine, &cosine);
    for (int i = 0; i < 3; i++) plane(g, &sine, &cosine, &R[0][i], &R[1][i]);
  }
  if (s->angled) {
    linear_model(g, s->angle, u, h, &angle), sine_cosine(g, &angle, &sine, &cosine);
    turn_model(s, &sine, &cosine, p);
    for (int i = 0; i < 3; i++) turn_model(s, &sine, &cosine, R[i]);
  }
  for (int i = 0; i < 3; i++) constant(g, s->o[i], &e), add(g, p + i, 1, &e, p + i);
}

static void screw_model(const Cell *s, int l, Model (*R)[3], const Model *o, Model *xi) {
  const Space *g = &s->space;
  const Problem *f = s->chain;
  Model axis[3];
  if (f->level[l])
    for (int i = 0; i < 3; i++) constant(g, f->a[3 * l + i], axis + i);
  else combine_columns(g, R, f->a + 3 * l, axis);
  if (f->revolute[l]) cross_models(g, o, axis, xi);
  for (int i = 0; i < 3; i++) {
    if (f->revolute[l]) xi[3 + i] = axis[i];
    else xi[i] = axis[i], constant(g, 0, xi + 3 + i);
  }
}

/* Move by one joint; by minus its position towards the base. */
static void joint_model(const Cell *s, int l, const Model *theta, double sign, Model (*R)[3], Model *o) {
  const Space *g = &s->space;
  const Problem *f = s->chain;
  Model sine, cosine, x[3], e;
  if (!f->revolute[l]) {
    combine_columns(g, R, f->a + 3 * l, x);
    for (int i = 0; i < 3; i++) product(g, theta, x + i, &e), add(g, o + i, sign, &e, o + i);
    return;
  }
  sine_cosine(g, theta, &sine, &cosine);
  if (sign < 0) scale(g, -1, &sine);
  turn_frame(g, s->bases + 9 * l, 0, R);
  for (int i = 0; i < 3; i++) plane(g, &sine, &cosine, &R[0][i], &R[1][i]);
  turn_frame(g, s->bases + 9 * l, 1, R);
}

typedef struct {
  Model R[3][3], base[3][3], tip[3], o[3], p[3], x[3][3], xi[6], theta;
  Lanes sizes[3], trace; /* |p|, |e|, |s| */
} Closure;

static Lanes length_of(const Model *x) {
  Lanes a = most_of(x), b = most_of(x + 1), c = most_of(x + 2);
  return root(a * a + b * b + c * c) * (1 + 1e-12);
}

/* The screws of the chain at q_ref, (P 6,), and the displacement from its frame to the pose. */
static void chain_models(const Cell *s, const Model *Q, Model *screws, Closure *f) {
  const Space *g = &s->space;
  const Problem *c = s->chain;
  Model e[3], y[3], turned[3];
  for (int way = 0; way < 2; way++) {
    Model(*R)[3] = way ? f->base : f->R, *o = way ? f->o : f->tip;
    for (int i = 0; i < 3; i++) {
      constant(g, -c->shift[i], o + i);
      for (int l = 0; l < 3; l++) constant(g, i == l, &R[l][i]);
    }
    for (int l = way ? c->k - 1 : c->k; way ? l >= 0 : l < c->P; l += way ? -1 : 1) {
      constant(g, c->o[l], &f->theta);
      for (int t = c->first[l]; t < c->first[l + 1]; t++)
        if (c->column[t] < c->n) add(g, &f->theta, c->S[t], Q + c->column[t], &f->theta);
      if (!way) {
        combine_columns(g, R, c->p + 3 * l, e);
        for (int i = 0; i < 3; i++) add(g, o + i, 1, e + i, o + i);
        turn_frame(g, c->R + 9 * l, 0, R);
      }
      screw_model(s, l, R, o, screws + 6 * l);
      joint_model(s, l, &f->theta, way ? -1 : 1, R, o);
      if (way) {
        turn_frame(g, c->R + 9 * l, 1, R);
        combine_columns(g, R, c->p + 3 * l, e);
        for (int i = 0; i < 3; i++) add(g, o + i, -1, e + i, o + i);
      }
    }
  }
  apply_models(g, f->base, f->p, e);
  for (int i = 0; i < 3; i++) add(g, e + i, 1, f->o + i, e + i), add(g, e + i, -1, f->tip + i, e + i);
  for (int i = 0; i < 3; i++)
    if (s->slides >> i & 1) { /* no way along an axis of the base that is not controlled */
      Model along, x;
      constant(g, 0, &along);
      for (int l = 0; l < 3; l++) product(g, &f->base[i][l], e + l, &x), add(g, &along, 1, &x, &along);
      for (int l = 0; l < 3; l++) product(g, &f->base[i][l], &along, &x), add(g, e + l, -1, &x, e + l);
    }
  f->trace = all(s->turned < 3 ? 0 : 3);
  for (int l = 0; l < 3; l++) constant(g, 0, f->xi + 3 + l);
  for (int i = s->turned; i < 3; i++) {
    apply_models(g, f->base, f->x[i], y);
    cross_models(g, f->R[i], y, turned);
    for (int l = 0; l < 3; l++) {
      f->trace += f->R[i][l].p[0] * y[l].p[0];
      add(g, f->xi + 3 + l, 1, turned + l, f->xi + 3 + l);
    }
  }
  if (s->turned == 2) f->trace = 1 + 2 * f->trace; /* the shortest rotation of one axis */
  else
    for (int l = 0; l < 3; l++) scale(g, 0.5, f->xi + 3 + l);
  cross_models(g, f->tip, f->xi + 3, y);
  f->sizes[0] = length_of(f->tip) + c->eps, f->sizes[1] = length_of(e) + c->eps;
  f->sizes[2] = length_of(f->xi + 3) + c->eps;
  for (int i = 0; i < 3; i++) add(g, e + i, 1, y + i, f->xi + i);
  for (int i = 0; i < 6; i++) f->xi[i].r += c->eps * (1 + f->sizes[0]);
}

/* ---- one box ---- */

/* What the Taylor models give of one box. */
typedef struct {
  double p, e, s, trace;
  double *q, *wide, *step;            /* n, n, N: q_ref, its reach, |A xi| */
  double *first, *rest;               /* k N N, N N: A J_V - 1 at q_ref(u) */
  double *n_c, *dn, *n_rest;          /* n r, n r k, n r */
} Lane;

static void angles_of(const Problem *g, const double *q, const double *half, double *theta, double *eta) {
  for (int l = 0; l < g->P; l++) {
    theta[l] = g->o[l], eta[l] = 0;
    for (int t = g->first[l]; t < g->first[l + 1]; t++)
      if (g->column[t] < g->n)
        theta[l] += g->S[t] * q[g->column[t]], eta[l] += fabs(g->S[t]) * half[g->column[t]];
  }
}

/* Remainders of the columns of J in boxes theta +- eta. */
static void remainders_of(const Problem *g, const double *theta, const double *eta, double *linear, double *angular) {
  for (int c = 0; c < g->N; c++) linear[c] = angular[c] = 0;
  for (int l = 0; l < g->P; l++) {
    int from = l < g->k ? l + 1 : g->k, to = l < g->k ? g->k : l;
    double H_R = 0, H_P = 0, L = g->reach[l];
    for (int p = from; p < to; p++)
      if (g->revolute[p]) H_R += eta[p];
      else H_P += eta[p], L += fabs(theta[p]) + eta[p];
    double v = g->revolute[l] ? 0.5 * H_R * H_R * L + H_R * H_P : 0.5 * H_R * H_R;
    double o = g->revolute[l] && !g->level[l] ? 0.5 * H_R * H_R : 0;
    for (int t = g->first[l]; t < g->first[l + 1]; t++)
      linear[g->column[t]] += fabs(g->S[t]) * v, angular[g->column[t]] += fabs(g->S[t]) * o;
  }
}

/* Bound |A (J(q) - J(q_ref))| for |q - q_ref| <= near and |q_ref - q_c| <= wide, and add it to R. */
static void beside_chart(const Cell *s, const double *A, const double *norms, const double *B, const double *q,
                         const double *wide, const double *near, double *R) {
  const Problem *g = s->chain;
  int n = g->n, N = g->N, P = g->P;
  double both[n], theta[P], eta[P], one_v[N], one_w[N], two_v[N], two_w[N], total = 0, slides = 0, longest = 0;
  for (int i = 0; i < n; i++) both[i] = wide[i] + near[i];
  angles_of(g, q, wide, theta, eta), remainders_of(g, theta, eta, one_v, one_w);
  angles_of(g, q, both, theta, eta), remainders_of(g, theta, eta, two_v, two_w);
  for (int l = 0; l < P; l++) {
    total += eta[l];
    if (!g->revolute[l]) slides += fabs(theta[l]) + eta[l];
    if (g->reach[l] > longest) longest = g->reach[l];
  }
  double size = 1 + 2 * total, v = g->eps * s->columns * (1 + longest + slides) * size, w = g->eps * s->columns * size;
  for (int i = 0; i < N; i++) {
    const double *x = A + i * N;
    double tiny = (fabs(x[0]) + fabs(x[1]) + fabs(x[2])) * v + (fabs(x[3]) + fabs(x[4]) + fabs(x[5])) * w;
    for (int c = 0; c < N; c++) {
      double e = tiny;
      e += norms[2 * i] * (two_v[c] - one_v[c] * (1 - 1e-12)) + norms[2 * i + 1] * (two_w[c] - one_w[c] * (1 - 1e-12));
      for (int j = 0; j < n; j++) e += fabs(B[(j * N + i) * N + c]) * near[j];
      R[i * N + c] += e;
    }
  }
}

/* Bound |F - q_ref| by lifting the way from f(q_ref) to x, within near of q_ref: (n,). */
static int distance(const Cell *s, const Lane *at, const double *norms, double *D, const double *near, double *Y_) {
  const Problem *g = s->chain;
  int n = g->n, N = g->N, P = g->P;
  double off[P], away[P], theta[P], both[n], F[N][N], Y[N][N], DY[N][N], slides = 0, turned = 0, moved = 0;
  for (int i = 0; i < n; i++) both[i] = at->wide[i] + near[i];
  angles_of(g, at->q, near, theta, off), angles_of(g, at->q, both, theta, away);
  for (int l = 0; l < g->k; l++)
    if (!g->revolute[l]) slides += fabs(theta[l]) + away[l];
  for (int l = 0; l < g->k; l++) {
    if (g->revolute[l]) turned += off[l];
    moved += off[l] * (g->revolute[l] ? g->reach[l] + slides : 1);
  }
  if (!(at->s < 0.5) || !(at->trace > 1)) return 0;
  double more = at->s > 1e-300 ? fmax(asin(at->s) / at->s, 1) * (1 + 1e-12) : 1, angle = at->s * more;
  double angular = (more - 1) * at->s + turned * angle;
  double linear = (more - 1) * at->s * at->p + at->e * angle;
  linear += turned * (at->e + at->p * angle + at->e * angle) + moved * angle;
  for (int i = 0; i < N; i++) {
    double load = at->step[i] + norms[2 * i] * linear + norms[2 * i + 1] * angular;
    for (int c = 0; c < N; c++) F[i][c] = load * (1 + g->eps) + 1e-15;
  }
  if (!enclose(N, g->eps, (double(*)[N])D, F, Y, DY)) return 0;
  for (int i = 0; i < n; i++) Y_[i] = Y[i][0] * (1 + g->eps);
  return 1;
}

/* n_ref in a gauge with orthonormal columns: n_ref = V U, U upper triangular, G = U^-1, V = n_ref G. */
static int gauge(int n, int r, double V[r][n], double U[r][r], double G[r][r]) {
  for (int f = 0; f < r; f++)
    for (int e = 0; e < r; e++) U[f][e] = G[f][e] = 0;
  for (int f = 0; f < r; f++) {
    for (int e = 0; e < 2 * f; e++) {
      int o = e % f;
      double c = 0;
      for (int i = 0; i < n; i++) c += V[f][i] * V[o][i];
      for (int i = 0; i < n; i++) V[f][i] -= c * V[o][i];
      U[o][f] += c;
    }
    double c = 0;
    for (int i = 0; i < n; i++) c += V[f][i] * V[f][i];
    c = sqrt(c);
    if (!(c > 1e-290)) return 0;
    for (int i = 0; i < n; i++) V[f][i] /= c;
    U[f][f] = c;
  }
  for (int f = 0; f < r; f++) {
    G[f][f] = 1 / U[f][f];
    for (int e = f - 1; e >= 0; e--) {
      double c = 0;
      for (int o = e + 1; o <= f; o++) c += U[e][o] * G[o][f];
      G[e][f] = -c / U[e][e];
    }
  }
  return 1;
}

/* The margins along F, with |F - q_ref| <= Y. */
static int along_function(const Cell *s, const Lane *at, const double *A, const double *R, const double *reach,
                          double *leaf, double *sigma) {
  const Problem *g = s->chain;
  int n = g->n, N = g->N, P = g->P, r = g->r, k = s->space.k;
  double V[r][n], U[r][r], G[r][r], X[N][N], dV[r][n][k], rest[r][n], theta[P], eta[P], t = s->tool;
  for (int f = 0; f < r; f++)
    for (int i = 0; i < n; i++) V[f][i] = at->n_c[i * r + f];
  if (!gauge(n, r, V, U, G)) return 0;
  for (int i = 0; i < N; i++) { /* A, with its last columns in the gauge */
    for (int c = 0; c < 6; c++) X[i][c] = A[i * N + c];
    for (int f = 0; f < r; f++) {
      X[i][6 + f] = 0;
      for (int e = f; e < r; e++) X[i][6 + f] += A[i * N + 6 + e] * U[f][e];
    }
  }
  for (int f = 0; f < r; f++)
    for (int i = 0; i < n; i++) {
      rest[f][i] = 0;
      for (int a = 0; a < k; a++) dV[f][i][a] = 0;
      for (int e = 0; e <= f; e++) {
        rest[f][i] += fabs(G[e][f]) * at->n_rest[i * r + e];
        for (int a = 0; a < k; a++) dV[f][i][a] += at->dn[(i * r + e) * k + a] * G[e][f];
      }
    }
  angles_of(g, at->q, reach, theta, eta);
  for (int l = 0; l < P; l++)
    if (!g->revolute[l]) t += fabs(theta[l]) + eta[l];
  return margin_of(g, k, X, R, at->first, V, dV, rest, s->turned < 3 ? (t + sqrt(t * t + 4)) / 2 : 1, leaf, sigma);
}

/* Lambda where both solutions close to one pose. */
static int of_frames(const Cell *s, const double *step, const double *most, const double *o, double *linear,
                     double *angular) {
  const Problem *g = s->chain;
  int P = g->P;
  double H[P], W[P], before = 0, beyond = 0, V_2 = 0, sum = 0;
  for (int l = 0; l < P; l++) {
    int from = l < g->k ? l + 1 : g->k, to = l < g->k ? g->k : l;
    double H_R = 0, H_P = 0, L = g->reach[l];
    for (int p = from; p < to; p++)
      if (g->revolute[p]) H_R += step[p];
      else H_P += step[p], L += most[p] + fabs(o[p]);
    H[l] = g->revolute[l] ? H_R : 0, W[l] = g->revolute[l] ? L * H_R + H_P : H_R;
    if (g->revolute[l]) *(l < g->k ? &before : &beyond) += step[l];
    if (l >= g->k) V_2 += (g->revolute[l] ? L : 1) * step[l];
    sum += H[l] * step[l];
  }
  double Omega = before + beyond, away = 1 - Omega, kappa = 0.5 / away;
  if (!(Omega < 0.9)) return 0;
  double tau = (1 + kappa * Omega) * sum + fmin(before, beyond);
  for (int l = 0; l < P; l++)
    for (int t = g->first[l]; t < g->first[l + 1]; t++) {
      double f = fabs(g->S[t]) * (1 + 1e-9);
      linear[g->column[t]] += f * (kappa * V_2 * H[l] + tau / away * (0.5 * W[l] + kappa * V_2 * H[l]));
      angular[g->column[t]] += f * kappa * tau * H[l];
    }
  return 1;
}

/* Lambda where both close to one position; loose is added to it in the rows of the free rotations. */
static int of_points(const Cell *s, const double *step, double *linear, double *loose) {
  const Problem *g = s->chain;
  int P = g->P;
  double Omega = 0;
  for (int l = 0; l < g->k; l++)
    if (g->revolute[l]) Omega += step[l];
  if (!(Omega < 0.9)) return 0;
  for (int l = 0; l < P; l++) {
    if (g->level[l]) continue;
    int from = l < g->k ? l + 1 : g->k, to = l < g->k ? g->k : l;
    double H_R = 0, K = 0;
    for (int p = from; p < to; p++)
      if (g->revolute[p]) H_R += step[p];
    if (g->revolute[l]) {
      for (int p = l; p < P; p++)
        if (!g->revolute[p]) K += step[p];
        else if (p >= g->k) K += s->tips[p] * step[p];
      K += s->tips[l] * H_R;
    } else K = H_R;
    for (int t = g->first[l]; t < g->first[l + 1]; t++) {
      double f = fabs(g->S[t]) * (1 + 1e-9) * K;
      linear[g->column[t]] += f * 0.5 * Omega / (1 - Omega), loose[g->column[t]] += f;
    }
  }
  return 1;
}

/* Bound int J delta dt by Lambda |delta| for |delta| <= steps, and add |A| Lambda to D. */
static int commutator(const Cell *s, const double *norms, const double *steps, double *D) {
  const Problem *g = s->chain;
  int n = g->n, N = g->N, P = g->P;
  double zero[n], o[P], step[P], most[P], linear[N], angular[N], loose[N], turned = 0;
  for (int i = 0; i < n; i++) zero[i] = 0;
  angles_of(g, zero, steps, o, step), angles_of(g, zero, s->farthest, o, most);
  for (int l = 0; l < P; l++)
    if (g->revolute[l]) turned += step[l];
  for (int l = 0; l < P; l++) /* the spin that closes an axis task */
    if (!g->level[l] && g->revolute[l] && g->column[g->first[l]] >= n) step[l] = turned;
  for (int c = 0; c < N; c++) linear[c] = angular[c] = loose[c] = 0;
  if (!(s->turned < 3 ? of_frames(s, step, most, o, linear, angular) : of_points(s, step, linear, loose))) return 0;
  for (int i = 0; i < N; i++) {
    int free = 0;
    for (int l = 0; l < P; l++)
      if (g->level[l] && g->first[l] < g->first[l + 1]) free |= g->column[g->first[l]] == i;
    for (int c = 0; c < N; c++)
      D[i * N + c] += norms[2 * i] * (linear[c] + free * loose[c]) + norms[2 * i + 1] * angular[c];
  }
  return 1;
}

static void one_cell_box(const Cell *s, const Lane *at, const double *A, const double *B, long box, const Margins *out) {
  const Problem *g = s->chain;
  int n = g->n, N = g->N, k = s->space.k;
  double eps = g->eps, norms[2 * N], size[N * N], R[N * N], D[N * N], Y[n], closer[n], reach[n];
  double F[N][N], Z[N][N], DZ[N][N], limit = INFINITY;
  for (int i = 0; i < N; i++) norms[2 * i] = norm3(A + i * N), norms[2 * i + 1] = norm3(A + i * N + 3);
  for (int i = 0; i < N * N; i++) {
    size[i] = 0, R[i] = at->rest[i];
    for (int a = 0; a < k; a++) size[i] += fabs(at->first[a * N * N + i]);
  }
  beside_chart(s, A, norms, B, at->q, at->wide, s->near, R);
  for (int i = 0; i < N * N; i++) D[i] = size[i] + R[i];
  if (!distance(s, at, norms, D, s->near, Y)) return;
  for (int i = 0; i < n; i++) {
    if (!(Y[i] <= s->near[i])) return;
    reach[i] = s->near[i] + Y[i];
  }
  for (int i = 0; i < N; i++)
    for (int c = 0; c < N; c++) F[i][c] = 1;
  if (!commutator(s, norms, reach, D)) return;
  if (!enclose(N, eps, (double(*)[N])D, F, Z, DZ)) return; /* F is the only solution within d* of q_ref */
  for (int i = 0; i < N * N; i++) R[i] = at->rest[i];
  beside_chart(s, A, norms, B, at->q, at->wide, Y, R);
  for (int i = 0; i < N * N; i++) D[i] = size[i] + R[i];
  if (distance(s, at, norms, D, Y, closer))
    for (int i = 0; i < n; i++) Y[i] = fmin(Y[i], closer[i]);
  for (int i = 0; i < n; i++) {
    reach[i] = (at->wide[i] + Y[i]) * (1 + eps) + 9e-16 * fabs(at->q[i]);
    limit = fmin(limit, fmin(at->q[i] - reach[i] - s->lower[i], s->upper[i] - at->q[i] - reach[i]));
  }
  if (!along_function(s, at, A, R, reach, out->leaf + box, out->sigma + box)) return;
  for (int i = 0; i < n; i++) out->reach[box * n + i] = reach[i];
  out->limit[box] = limit;
}

/* ---- LANES boxes ---- */

typedef struct {
  Model *chart, *screws, *J; /* w, P 6, (6 + r) N */
  Closure closure;
} Work;

/* A (J_V) - 1 at q_ref(u): slopes and the rest; and A xi. */
static void after_A(const Cell *s, const Work *w, const Lanes *A, Lanes *first, Lanes *rest, Lanes *step) {
  const Problem *g = s->chain;
  int N = g->N, k = s->space.k, M = s->space.M;
  for (int i = 0; i < N; i++) {
    for (int c = 0; c < N; c++) {
      Lanes e = all(0);
      for (int m = 0; m < M; m++) {
        Lanes v = all(0);
        for (int x = 0; x < N; x++) v += A[i * N + x] * w->J[x * N + c].p[m];
        if (m == 0) e += absolute(v - (i == c));
        else if (m <= k) first[((m - 1) * N + i) * N + c] = v;
        else e += absolute(v);
      }
      for (int x = 0; x < N; x++) {
        const Model *y = w->J + x * N + c;
        e += absolute(A[i * N + x]) * (y->r + g->eps * size_of(y));
      }
      rest[i * N + c] = e;
    }
    Lanes sum = all(0);
    for (int m = 0; m < M; m++) {
      Lanes v = all(0);
      for (int x = 0; x < 6; x++) v += A[i * N + x] * w->closure.xi[x].p[m];
      sum += absolute(v);
    }
    for (int x = 0; x < 6; x++) {
      const Model *y = w->closure.xi + x;
      sum += absolute(A[i * N + x]) * (y->r + g->eps * size_of(y));
    }
    step[i] = sum * (1 + g->eps);
  }
}

static void some_boxes(const Cell *s, const double *U, const double *half, long at, int count, Work *w, const Margins *out) {
  const Problem *g = s->chain;
  const Space *sp = &s->space;
  int n = g->n, N = g->N, P = g->P, r = g->r, k = sp->k, x = 1 + r;
  Lanes u[k], h[k], A[N * N], first[k * N * N], rest[N * N], step[N];
  for (int a = 0; a < k; a++)
    for (int l = 0; l < LANES; l++) {
      long box = at + (l < count ? l : 0);
      u[a][l] = U[box * k + a], h[a][l] = half[box * k + a];
    }
  chart_models(s, u, h, w->chart);
  Model *Q = w->screws + 6 * P; /* n models: q_ref without n_ref between */
  for (int i = 0; i < n; i++) Q[i] = w->chart[i * x];
  pose_models(s, u, h, w->closure.p, w->closure.x);
  chain_models(s, Q, w->screws, &w->closure);
  for (int i = 0; i < N * N; i++) constant(sp, 0, w->J + i);
  for (int l = 0; l < P; l++)
    for (int t = g->first[l]; t < g->first[l + 1]; t++)
      for (int i = 0; i < 6; i++) {
        Model *y = w->J + i * N + g->column[t];
        add(sp, y, g->S[t], w->screws + 6 * l + i, y);
      }
  for (int a = 0; a < r; a++)
    for (int i = 0; i < n; i++) w->J[(6 + a) * N + i] = w->chart[i * x + 1 + a];

  double q[LANES][n], zero[n], theta[P], eta[P], B[LANES][n * N * N], A_[LANES][N * N];
  int regular[LANES];
  for (int i = 0; i < n; i++) zero[i] = 0;
  for (int l = 0; l < LANES; l++) {
    double J[N][6], dJ[n][N][6], M[N][N], linear[N], angular[N];
    char turns[n][N];
    for (int i = 0; i < n; i++) q[l][i] = Q[i].p[0][l];
    angles_of(g, q[l], zero, theta, eta);
    columns(g, theta, eta, J, dJ, turns, linear, angular);
    for (int i = 0; i < N; i++)
      for (int c = 0; c < N; c++) M[i][c] = w->J[i * N + c].p[0][l];
    regular[l] = invert(N, M, (double(*)[N])A_[l]);
    for (int i = 0; i < N * N; i++) A[i][l] = regular[l] ? A_[l][i] : 0;
    for (int j = 0; j < n; j++)
      for (int i = 0; i < N; i++)
        for (int c = 0; c < N; c++) {
          double e = 0;
          if (turns[j][c])
            for (int y = 0; y < 6; y++) e += A_[l][i * N + y] * dJ[j][c][y];
          B[l][(j * N + i) * N + c] = e;
        }
  }
  after_A(s, w, A, first, rest, step);

  double wide[n], step_[N], first_[k * N * N], rest_[N * N], n_c[n * r], dn[n * r * k], n_rest[n * r];
  for (int l = 0; l < count; l++) {
    long box = at + l;
    const Closure *f = &w->closure;
    Lane lane = {f->sizes[0][l], f->sizes[1][l], f->sizes[2][l], f->trace[l],
                 q[l], wide, step_, first_, rest_, n_c, dn, n_rest};
    out->split[box] = 0, out->leaf[box] = out->sigma[box] = 0, out->limit[box] = -INFINITY;
    double best = -1;
    for (int a = 0; a < k; a++) {
      double cost = 0;
      for (int i = 0; i < n; i++) cost += fabs(Q[i].p[1 + a][l]);
      if (cost > best) best = cost, out->split[box] = a;
    }
    for (int i = 0; i < n; i++) {
      wide[i] = (size_of(Q + i)[l] - fabs(Q[i].p[0][l]) + Q[i].r[l]) * (1 + 1e-12) + 1e-14 * fabs(q[l][i]);
      out->Q[box * n + i] = q[l][i];
      for (int a = 0; a < r; a++) {
        const Model *y = w->chart + i * x + 1 + a;
        double e = y->r[l];
        for (int m = 1 + k; m < sp->M; m++) e += fabs(y->p[m][l]);
        n_c[i * r + a] = y->p[0][l], n_rest[i * r + a] = e;
        for (int b = 0; b < k; b++) dn[(i * r + a) * k + b] = y->p[1 + b][l];
      }
    }
    if (!regular[l]) continue;
    for (int i = 0; i < N; i++) step_[i] = step[i][l];
    for (int i = 0; i < N * N; i++) rest_[i] = rest[i][l];
    for (int i = 0; i < k * N * N; i++) first_[i] = first[i][l];
    one_cell_box(s, &lane, A_[l], B[l], box, out);
  }
}

EXPORT int LEVELLED(cell_bounds)(const Cell *s, long K, const double *U, const double *half, const Margins *out) {
  const Problem *g = s->chain;
  size_t models = s->w + 6 * g->P + g->n + g->N * g->N;
  Model *memory = malloc(models * sizeof(Model));
  Work *w = malloc(sizeof(Work));
  if (memory && w) {
    w->chart = memory, w->screws = memory + s->w, w->J = w->screws + 6 * g->P + g->n;
    for (long i = 0; i < K; i += LANES) some_boxes(s, U, half, i, K - i < LANES ? K - i : LANES, w, out);
  }
  int done = memory && w;
  free(memory), free(w);
  return done;
}
