/* A cell's function over boxes of poses: see docs/theory.md, "Proved, not sampled", "A cell".

   LANES boxes at a time where there are Taylor models, one box at a time elsewhere. */

#include "linear_algebra.h"
#include "leaf_margin_bounds.h"
#include "taylor.h"

typedef struct Cell {
  const Chain *chain;
  Space space;
  int r, w, terms, F, turning, angled, spun; /* potentials, n (1 + r), monomials of the chart, what moves the pose */
  int m, removed;                          /* coordinates of the task, and those that symmetries take out of u */
  int turned, slides;                      /* first column of R that the task controls, 3: none; base axes left free */
  int bent, radial, upright, levels;       /* degree of a sector's profile; its radius and height among u; sizes of d* */
  double eps, tool, columns;               /* rounding, the tool's distance, the largest column of S */
  const int *parent, *variable, *used;     /* terms, terms, M: how many terms each derivative has */
  const int *fourth;                       /* F 4: variables of the products of degree 4 */
  const double *parts, *rest, *blur;       /* M terms w, F w, w: derivatives, fourth ones, rounding */
  const double *near, *lower, *upper;      /* levels n, n, n: d*, the largest first; limits */
  const double *farthest;                  /* n: largest values of the joints */
  const double *o, *a, *d, *R0, *D, *Omega, *angle, *spin; /* 3, 3, 3, 3 3, 3 k, 3 k, k, k: the poses */
  const double *way, *turn, *around, *twirl; /* m 3, m 3, m, m: motion of the pose along each coordinate, see pose_models */
  const double *outward, *profile;         /* 3, bent + 1 each: radial direction of the middle; bend and stretch */
  const double *widths, *along;            /* k: m or rad per unit of u; n removed: motion of the joints */
  const int *beneath, *powers;             /* k M, k M: derivatives of monomials, and their factors */
  const double *bases;                     /* P 3 3: rotations whose third columns are the axes */
  const double *tips;                      /* P: distances from the frame */
} Cell;

typedef struct Margins {
  double *leaf, *sigma, *limit, *Q, *reach;
  double *V; /* r n (2 + k), or null: V along F, its value at the centre, its slopes, and the bound of all else */
  int *split, *level; /* coordinate to halve; index of the d* within which F is the only solution, or -1 */
} Margins;

/* ---- Taylor models of the chart, the poses and the chain ---- */

/* R x, R by columns */
static void apply_models(const Space *g, Model (*R)[3], const Model *x, Model *out) {
  for (int i = 0; i < 3; i++) {
    product(g, &R[0][i], x, out + i);
    for (int c = 1; c < 3; c++) add_product(g, &R[c][i], x + c, 1, out + i);
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
  Model y[3], z[3];
  cross_constant(g, s->a, x, y), cross_constant(g, s->a, y, z);
  for (int i = 0; i < 3; i++) add_product(g, sine, y + i, 1, x + i), add_product(g, cosine, z + i, -1, x + i);
  add_vectors(g, x, 1, z, x);
}

static int moves(const double *a) { return a[0] != 0 || a[1] != 0 || a[2] != 0; }

/* J_l W: what the left Jacobian of exp at omega makes of a rate W of omega, W + d w x W + e (w w'W - z W) */
static void left_jacobian(const Space *g, const Model *omega, const Model *z, const Model *d, const Model *e,
                          const double *W, Model *out) {
  Model turned[3], along, x, y;
  constants(g, W, out);
  cross_constant(g, W, omega, turned);
  combine(g, W, omega, &along);
  product(g, e, &along, &x), product(g, e, z, &y);
  for (int i = 0; i < 3; i++) {
    add(g, out + i, -W[i], &y, out + i);
    add_product(g, d, turned + i, -1, out + i);
    add_product(g, &x, omega + i, 1, out + i);
  }
}

/* Coordinate a of the cell, m or rad from its middle. */
static void coordinate_model(const Cell *s, int a, const Lanes *u, const Lanes *h, Model *out) {
  double row[6] = {0};
  row[a] = s->widths[a];
  linear_model(&s->space, row, u, h, out);
}

/* Bend and stretch of a sector's radius at a height, and their derivatives by the height: sides_at in chart.c. */
static void side_models(const Cell *s, const Model *height, Model *side, Model *slope) {
  const Space *g = &s->space;
  Model part;
  for (int i = 0; i < 2; i++) {
    const double *c = s->profile + i * (s->bent + 1);
    constant(g, c[s->bent], side + i), constant(g, 0, slope + i);
    for (int l = s->bent - 1; l >= 0; l--) {
      product(g, slope + i, height, &part), add(g, &part, 1, side + i, slope + i);
      constant(g, c[l], &part), add_product(g, side + i, height, 1, &part), copy(g, &part, side + i);
    }
  }
}

/* Bend a sector with one range of radius: the place p and the twists of radius y and height, before they turn with the
   angle. The radius is the middle's + b + s y in place of the middle's + y. */
static void bend_models(const Cell *s, const Lanes *u, const Lanes *h, Model *p, Model (*twists)[6]) {
  const Space *g = &s->space;
  Model radius, height, side[2], slope[2];
  coordinate_model(s, s->radial, u, h, &radius), coordinate_model(s, s->upright, u, h, &height);
  side_models(s, &height, side, slope);
  add_product(g, side + 1, &radius, 1, side), add(g, side, -1, &radius, side); /* b + s y - y */
  add_product(g, slope + 1, &radius, 1, slope);                                /* b' + s' y */
  for (int i = 0; i < 3; i++) {
    double along = s->outward[i];
    add(g, p + i, along, side, p + i);
    copy(g, side + 1, twists[s->radial] + i), scale(g, along, twists[s->radial] + i);
    add(g, twists[s->upright] + i, along, slope, twists[s->upright] + i);
  }
}

/* The place of the pose and its columns, from the base; and its velocity (v, w) per metre or radian of each of the m
   coordinates of the task: a way that turns with the angle, a turn, a turn about the cell's axis, or about the tool's. */
static void pose_models(const Cell *s, const Lanes *u, const Lanes *h, Model *p, Model (*R)[3], Model (*twists)[6]) {
  const Space *g = &s->space;
  Model sine, cosine, angle, place[3];
  for (int a = 0; a < s->m; a++) constants(g, s->way + 3 * a, twists[a]), constants(g, s->turn + 3 * a, twists[a] + 3);
  for (int i = 0; i < 3; i++) {
    linear_model(g, s->D + i * g->k, u, h, p + i);
    for (int c = 0; c < 3; c++) constant(g, s->R0[3 * i + c], &R[c][i]);
  }
  constants(g, s->d, place), add_vectors(g, p, 1, place, p);
  if (s->bent) bend_models(s, u, h, p, twists);
  if (s->turning) { /* (c + s w^ + d w w') R0 */
    Model omega[3], z, c[4], turned[3], tilted[3], along;
    for (int i = 0; i < 3; i++) linear_model(g, s->Omega + i * g->k, u, h, omega + i);
    dot_models(g, omega, omega, &z), exponential(g, &z, c);
    for (int i = 0; i < 3; i++) {
      const double *b = s->R0 + i, column[3] = {b[0], b[3], b[6]}, back[3] = {-b[0], -b[3], -b[6]};
      combine(g, column, omega, &along);
      cross_constant(g, back, omega, tilted); /* w x b */
      times_model(g, c, R[i], turned);
      for (int l = 0; l < 3; l++) {
        product(g, &along, omega + l, &angle);
        add_product(g, c + 1, tilted + l, 1, turned + l), add_product(g, c + 2, &angle, 1, turned + l);
      }
      copy_vector(g, turned, R[i]);
    }
    for (int a = 0; a < s->m; a++)
      if (moves(s->turn + 3 * a)) left_jacobian(g, omega, &z, c + 2, c + 3, s->turn + 3 * a, twists[a] + 3);
  }
  if (s->spun) {
    linear_model(g, s->spin, u, h, &angle), sine_cosine(g, &angle, &sine, &cosine);
    for (int i = 0; i < 3; i++) plane(g, &sine, &cosine, &R[0][i], &R[1][i]);
  }
  if (s->angled) {
    linear_model(g, s->angle, u, h, &angle), sine_cosine(g, &angle, &sine, &cosine);
    turn_model(s, &sine, &cosine, p);
    for (int i = 0; i < 3; i++) turn_model(s, &sine, &cosine, R[i]);
    for (int a = 0; a < s->m; a++) {
      if (moves(s->way + 3 * a)) turn_model(s, &sine, &cosine, twists[a]);
      if (moves(s->turn + 3 * a)) turn_model(s, &sine, &cosine, twists[a] + 3);
    }
  }
  for (int a = 0; a < s->m; a++) {
    if (s->around[a] != 0) cross_constant(g, s->a, p, twists[a]), constants(g, s->a, twists[a] + 3);
    if (s->twirl[a] != 0) copy_vector(g, R[2], twists[a] + 3);
  }
  constants(g, s->o, place), add_vectors(g, p, 1, place, p);
}

static void screw_model(const Cell *s, int l, Model (*R)[3], const Model *o, Model *xi) {
  const Space *g = &s->space;
  const Chain *f = s->chain;
  Model axis[3];
  if (f->level[l]) constants(g, f->a + 3 * l, axis);
  else combine_columns(g, R, f->a + 3 * l, axis);
  if (f->revolute[l]) {
    cross_models(g, o, axis, xi), copy_vector(g, axis, xi + 3);
  } else {
    copy_vector(g, axis, xi), constants(g, NO_VECTOR, xi + 3);
  }
}

/* Move by one joint; by minus its position towards the base. */
static void joint_model(const Cell *s, int l, const Model *theta, double sign, Model (*R)[3], Model *o) {
  const Space *g = &s->space;
  const Chain *f = s->chain;
  Model sine, cosine, x[3];
  if (!f->revolute[l]) {
    combine_columns(g, R, f->a + 3 * l, x);
    for (int i = 0; i < 3; i++) add_product(g, theta, x + i, sign, o + i);
    return;
  }
  sine_cosine(g, theta, &sine, &cosine);
  if (sign < 0) scale(g, -1, &sine);
  turn_about(g, s->bases + 9 * l, &sine, &cosine, R);
}

typedef struct {
  Model R[3][3], base[3][3], tip[3], o[3], p[3], x[3][3], xi[6], theta;
  Model twists[6][6];    /* of the pose, (v, w) per unit of each coordinate of the task: first from the base, then from the middle */
  Lanes sizes[3], trace; /* |p|, |e|, |s| */
} Closure;

static Lanes length_of(const Model *x) {
  Lanes a = most_of(x), b = most_of(x + 1), c = most_of(x + 2);
  return root(a * a + b * b + c * c) * (1 + 1e-12);
}

/* The twists of the pose at place p, as seen from the middle link. */
static void twist_models(const Cell *s, Closure *f, const Model *p) {
  const Space *g = &s->space;
  Model v[3], w[3], moment[3];
  for (int a = 0; a < s->m; a++) {
    Model *x = f->twists[a];
    if (s->angled || s->bent || s->around[a] != 0) {
      apply_models(g, f->base, x, v), copy_vector(g, v, x);
    } else combine_columns(g, f->base, s->way + 3 * a, x);
    if (moves(s->turn + 3 * a) || s->around[a] != 0 || s->twirl[a] != 0) {
      apply_models(g, f->base, x + 3, w), cross_models(g, p, w, moment);
      add_vectors(g, x, 1, moment, x), copy_vector(g, w, x + 3);
    }
    Lanes size = s->eps * (1 + length_of(x));
    for (int i = 0; i < 6; i++) x[i].r += size;
  }
}

/* The screws of the chain at q_ref, (P 6,), the displacement from its frame to the pose, and the pose's twists. */
static void chain_models(const Cell *s, const Model *Q, Model *screws, Closure *f) {
  const Space *g = &s->space;
  const Chain *c = s->chain;
  Model e[3], y[3], turned[3];
  for (int way = 0; way < 2; way++) {
    Model(*R)[3] = way ? f->base : f->R, *o = way ? f->o : f->tip;
    identity_models(g, R);
    for (int i = 0; i < 3; i++) constant(g, -c->shift[i], o + i);
    for (int l = way ? c->k - 1 : c->k; way ? l >= 0 : l < c->P; l += way ? -1 : 1) {
      constant(g, c->o[l], &f->theta);
      for (int t = c->first[l]; t < c->first[l + 1]; t++)
        if (c->column[t] < c->n) add(g, &f->theta, c->S[t], Q + c->column[t], &f->theta);
      if (!way) {
        combine_columns(g, R, c->p + 3 * l, e);
        add_vectors(g, o, 1, e, o);
        turn_frame(g, c->R + 9 * l, 0, R);
      }
      screw_model(s, l, R, o, screws + 6 * l);
      joint_model(s, l, &f->theta, way ? -1 : 1, R, o);
      if (way) {
        turn_frame(g, c->R + 9 * l, 1, R);
        combine_columns(g, R, c->p + 3 * l, e);
        add_vectors(g, o, -1, e, o);
      }
    }
  }
  apply_models(g, f->base, f->p, e), add_vectors(g, e, 1, f->o, e);
  twist_models(s, f, e);
  add_vectors(g, e, -1, f->tip, e);
  for (int i = 0; i < 3; i++)
    if (s->slides >> i & 1) { /* no way along an axis of the base that is not controlled */
      Model along;
      dot_models(g, f->base[i], e, &along);
      for (int l = 0; l < 3; l++) add_product(g, f->base[i] + l, &along, -1, e + l);
    }
  f->trace = all(s->turned < 3 ? 0 : 3);
  constants(g, NO_VECTOR, f->xi + 3);
  for (int i = s->turned; i < 3; i++) {
    apply_models(g, f->base, f->x[i], y);
    cross_models(g, f->R[i], y, turned);
    add_vectors(g, f->xi + 3, 1, turned, f->xi + 3);
    for (int l = 0; l < 3; l++) f->trace += f->R[i][l].p[0] * y[l].p[0];
  }
  if (s->turned == 2) f->trace = 1 + 2 * f->trace; /* the shortest rotation of one axis */
  else
    for (int l = 0; l < 3; l++) scale(g, 0.5, f->xi + 3 + l);
  cross_models(g, f->tip, f->xi + 3, y);
  f->sizes[0] = length_of(f->tip) + s->eps, f->sizes[1] = length_of(e) + s->eps;
  f->sizes[2] = length_of(f->xi + 3) + s->eps;
  add_vectors(g, e, 1, y, f->xi);
  for (int i = 0; i < 6; i++) f->xi[i].r += s->eps * (1 + f->sizes[0]);
}

/* ---- one box ---- */

/* What the Taylor models give of one box. A function is known by its value at the centre, its slopes along the k
   variables and the bound of all else. */
typedef struct {
  double p, e, s, trace;
  double *q, *wide, *step, *beside;   /* n, n, N, n: q_0, its reach, |A (xi, -n_ref' eta)|, |q_0 - c| */
  double *first, *rest;               /* k N N, N N: A J_V - 1 at q_ref(u) */
  double *Wrows, *Wfirst, *Wrest;     /* (N + r) 6, k (N + r) N, (N + r) N: rows times J, see potential_rows */
  double *J, *J_most, *K_most;        /* 6 N, 6 N, 6 N: J at q_0(u_c), |J| and |C J| at q_0(u) */
  double *V, *dV, *V_rest;            /* r n, k r n, r n: n_ref - W' J for a polynomial W' */
  double *W_away, *rho, *off;         /* r 6, r 6, 6 6: |W' - W_c|, |w - W' E|, |C E - 1| */
  double *steep;                      /* r m n: |dn_ref| */
} Lane;

/* Bound |A (J(q) - J(q_0))| for |q - q_0| <= near and |q_0 - q_c| <= wide, and add it to R. A has some rows of pitch
   numbers, and B (n, rows, N) = A dJ. For a mean over q, mean bounds the mean of |q - q_0|; else it is near. */
static void beside_chart(const Cell *s, int rows, int pitch, const double *A, const double *B, const double *q,
                         const double *wide, const double *near, const double *mean, double *R) {
  const Chain *g = s->chain;
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
  double size = 1 + 2 * total, v = s->eps * s->columns * (1 + longest + slides) * size, w = s->eps * s->columns * size;
  for (int i = 0; i < rows; i++) {
    const double *x = A + i * pitch;
    double tiny = (fabs(x[0]) + fabs(x[1]) + fabs(x[2])) * v + (fabs(x[3]) + fabs(x[4]) + fabs(x[5])) * w;
    for (int c = 0; c < N; c++) {
      double e = tiny;
      e += norm(x) * (two_v[c] - one_v[c] * (1 - 1e-12)) + norm(x + 3) * (two_w[c] - one_w[c] * (1 - 1e-12));
      for (int j = 0; j < n; j++) e += fabs(B[(j * rows + i) * N + c]) * mean[j];
      R[i * N + c] += e;
    }
  }
}

/* B (n, rows, N) = A dJ: A has some rows of pitch numbers, and dJ is (n, 6, N). */
static void rows_times_slopes(const Chain *g, int rows, int pitch, const double *A, const double *dJ,
                              double *restrict B) {
  const int N = g->N;
  for (int j = 0; j < g->n; j++)
    for (int i = 0; i < rows; i++) {
      double *restrict row = B + (j * rows + i) * N;
      for (int c = 0; c < N; c++) row[c] = 0;
      for (int y = 0; y < 6; y++)
        for (int c = 0; c < N; c++) row[c] += A[i * pitch + y] * dJ[(j * 6 + y) * N + c];
    }
}

/* dJ (n, 6, N) at q. */
static void slopes_at(const Chain *g, const double *q, double *dJ) {
  int n = g->n, N = g->N;
  double still[n], theta[g->P], none[g->P], J[N][6], by_column[n][N][6];
  char turns[n][N];
  for (int i = 0; i < n; i++) still[i] = 0;
  memset(J, 0, sizeof J), memset(by_column, 0, sizeof by_column), memset(turns, 0, sizeof turns);
  angles_of(g, q, still, theta, none);
  columns(g, theta, 0, 6, J, by_column, turns);
  for (int j = 0; j < n; j++)
    for (int c = 0; c < N; c++)
      for (int y = 0; y < 6; y++) dJ[(j * 6 + y) * N + c] = by_column[j][c][y];
}

/* By how much the middle link turns and moves while q is within near of q_ref. */
static void middle_link(const Cell *s, const Lane *at, const double *near, double *turned, double *moved) {
  const Chain *g = s->chain;
  double off[g->P], away[g->P], theta[g->P], both[g->n], slides = 0;
  for (int i = 0; i < g->n; i++) both[i] = at->wide[i] + near[i];
  angles_of(g, at->q, near, theta, off), angles_of(g, at->q, both, theta, away);
  for (int l = 0; l < g->k; l++)
    if (!g->revolute[l]) slides += fabs(theta[l]) + away[l];
  *turned = *moved = 0;
  for (int l = 0; l < g->k; l++) {
    if (g->revolute[l]) *turned += off[l];
    *moved += off[l] * (g->revolute[l] ? g->reach[l] + slides : 1);
  }
}

/* Bound |F - q_ref| by lifting the way from f(q_ref) to x, within near of q_ref: (n,). */
static int distance(const Cell *s, const Lane *at, const double *norms, double *D, const double *near, double *Y_) {
  const Chain *g = s->chain;
  int n = g->n, N = g->N;
  double F[N][N], Y[N][N], turned, moved;
  middle_link(s, at, near, &turned, &moved);
  if (!(at->s < 0.5) || !(at->trace > 1)) return 0;
  double more = at->s > 1e-300 ? fmax(asin(at->s) / at->s, 1) * (1 + 1e-12) : 1, angle = at->s * more;
  double angular = (more - 1) * at->s + turned * angle;
  double linear = (more - 1) * at->s * at->p + at->e * angle;
  linear += turned * (at->e + at->p * angle + at->e * angle) + moved * angle;
  for (int i = 0; i < N; i++) {
    double load = at->step[i] + norms[2 * i] * linear + norms[2 * i + 1] * angular;
    for (int c = 0; c < N; c++) F[i][c] = load * (1 + s->eps) + 1e-15;
  }
  if (!enclose(N, s->eps, (double(*)[N])D, F, Y)) return 0;
  for (int i = 0; i < n; i++) Y_[i] = Y[i][0] * (1 + s->eps);
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

/* Bound z with W - W' = z C, (6,), from rho = |w - W' E| and off = |C E - 1|: |rho (C E)^-1|, by its Neumann series in the
   sum norm from the third term on. */
static int left_rest(double eps, const double *rho, double off[6][6], double *z) {
  double most = 0, sum = 0;
  for (int i = 0; i < 6; i++) {
    double row = 0;
    for (int c = 0; c < 6; c++) row += off[i][c];
    most = fmax(most, row * (1 + eps)), sum += rho[i];
  }
  if (!(most < 0.9)) return 0;
  for (int c = 0; c < 6; c++) {
    z[c] = rho[c] + most * most * sum / (1 - most);
    for (int i = 0; i < 6; i++) z[c] += rho[i] * off[i][c];
    z[c] *= 1 + 4 * eps;
  }
  return 1;
}

/* The leaf margin along F, with |F - q_0| <= Y: of V' = n_ref' - W J and the null space of J at F. In W J and W E = w, all
   twists are seen from the middle link at q_0: those of the pose are then known, and J at F is turned and moved. */
static double leaf_margin_along(const Cell *s, const Lane *at, const double *A_, double C[6][6], const double *dJ,
                                const double *Y, double *out) {
  const Chain *g = s->chain;
  int n = g->n, N = g->N, r = s->r, k = s->space.k, m = s->m, rows = N + r;
  double eps = s->eps, V[r][n], U[r][r], G[r][r], X[N][N], dV[r][n][k], rest[r][n], R[N][N], slopes[k][N][PADDED(N)];
  double eye[36], beside[rows * N], plain[6 * N], BW[n * rows * N], off[6][6], away[2][N], V_rest[r][n];
  double turned, moved, h[k], Z[N][N], center, leaf;
  char on[k][N];
  int split = 0;

  for (int i = 0; i < 36; i++) eye[i] = i % 7 == 0;
  for (int i = 0; i < rows * N; i++) beside[i] = 0;
  for (int i = 0; i < 6 * N; i++) plain[i] = 0;
  rows_times_slopes(g, rows, 6, at->Wrows, dJ, BW);
  beside_chart(s, rows, 6, at->Wrows, BW, at->q, at->wide, Y, Y, beside);
  beside_chart(s, 6, 6, eye, dJ, at->q, at->wide, Y, Y, plain);

  middle_link(s, at, Y, &turned, &moved);
  for (int c = 0; c < N; c++) { /* how far J at F is turned and moved: linear and angular */
    double v[3], w[3];
    for (int x = 0; x < 3; x++) {
      v[x] = at->J_most[x * N + c] + plain[x * N + c];
      w[x] = at->J_most[(3 + x) * N + c] + plain[(3 + x) * N + c];
    }
    away[0][c] = (turned * norm(v) + moved * norm(w)) * (1 + eps), away[1][c] = turned * norm(w) * (1 + eps);
  }
  for (int c = 0; c < 6; c++)
    for (int i = 0; i < 6; i++) {
      off[i][c] = at->off[i * 6 + c];
      int d = n + c - m; /* a virtual joint */
      for (int x = 0; x < 6 && c >= m; x++) off[i][c] += fabs(C[i][x]) * (plain[x * N + d] + away[x / 3][d]) * (1 + eps);
    }

  for (int f = 0; f < r; f++) {
    const double *W_c = at->Wrows + (N + f) * 6, *W_away = at->W_away + f * 6;
    double rho[6], z[6], J_rest[N], linear = norm(W_c), angular = norm(W_c + 3);
    for (int x = 0; x < 3; x++) linear += W_away[x], angular += W_away[3 + x];
    for (int c = 0; c < N; c++) { /* |W' (J(F) - J(q_0))| */
      J_rest[c] = beside[(N + f) * N + c] + linear * away[0][c] + angular * away[1][c];
      for (int y = 0; y < 6; y++) J_rest[c] += W_away[y] * plain[y * N + c];
    }
    for (int c = 0; c < 6; c++) {
      double x = c < m ? 0 : J_rest[n + c - m];
      for (int i = 0; i < n && c < m; i++) x += at->steep[(f * m + c) * n + i] * Y[i];
      rho[c] = (at->rho[f * 6 + c] + x) * (1 + eps);
    }
    if (!left_rest(eps, rho, off, z)) return 0;
    for (int i = 0; i < n; i++) {
      double x = at->V_rest[f * n + i] + J_rest[i], size = fabs(at->V[f * n + i]);
      for (int y = 0; y < 6; y++) {
        double most = at->K_most[y * N + i];
        for (int l = 0; l < 6; l++) most += fabs(C[y][l]) * (plain[l * N + i] + away[l / 3][i]);
        x += z[y] * most;
      }
      for (int j = 0; j < k; j++) size += fabs(at->dV[(j * r + f) * n + i]);
      V_rest[f][i] = x + eps * (size + x);
      if (!out) continue;
      double *y = out + (f * n + i) * (2 + k);
      y[0] = at->V[f * n + i], y[1 + k] = V_rest[f][i];
      for (int j = 0; j < k; j++) y[1 + j] = at->dV[(j * r + f) * n + i];
    }
  }

  for (int f = 0; f < r; f++)
    for (int i = 0; i < n; i++) V[f][i] = at->V[f * n + i];
  if (!gauge(n, r, V, U, G)) return 0;
  for (int i = 0; i < N; i++) { /* A, with its last columns in the gauge; its upper columns belong to V_c too */
    for (int c = 0; c < 6; c++) X[i][c] = at->Wrows[i * 6 + c];
    for (int f = 0; f < r; f++) {
      X[i][6 + f] = 0;
      for (int e = f; e < r; e++) X[i][6 + f] += A_[i * N + 6 + e] * U[f][e];
    }
  }
  memset(slopes, 0, sizeof slopes);
  for (int i = 0; i < N; i++)
    for (int c = 0; c < N; c++) {
      double v = -(i == c), size = 1, e = at->Wrest[i * N + c] + beside[i * N + c];
      for (int x = 0; x < 6; x++) {
        double part = at->Wrows[i * 6 + x] * at->J[x * N + c];
        v += part, size += fabs(part);
      }
      for (int f = 0; f < r && c < n; f++) {
        double part = A_[i * N + 6 + f] * at->V[f * n + c];
        v += part, size += fabs(part);
      }
      R[i][c] = fabs(v) + e + eps * (size + e);
      for (int j = 0; j < k; j++) slopes[j][c][i] = at->Wfirst[(j * rows + i) * N + c];
    }
  for (int f = 0; f < r; f++)
    for (int i = 0; i < n; i++) {
      rest[f][i] = 0;
      for (int a = 0; a < k; a++) dV[f][i][a] = 0;
      for (int e = 0; e <= f; e++) {
        rest[f][i] += fabs(G[e][f]) * V_rest[e][i];
        for (int a = 0; a < k; a++) dV[f][i][a] += at->dV[(a * r + e) * n + i] * G[e][f];
      }
    }
  for (int a = 0; a < k; a++) h[a] = 1;
  memset(on, 1, sizeof on);
  margin_on(n, N, r, k, eps, h, X, R, slopes, on, V, dV, rest, Z, &leaf, &center, &split);
  return leaf;
}

/* Lambda where both solutions close to one pose. */
static int of_frames(const Cell *s, const double *step, const double *most, const double *o, double *linear,
                     double *angular) {
  const Chain *g = s->chain;
  int P = g->P;
  double H[P], W[P], before = 0, beyond = 0, V_2 = 0, sum = 0;
  for (int l = 0; l < P; l++) {
    const Between by = between(g, l, step, o, most);
    H[l] = g->revolute[l] ? by.H_R : 0, W[l] = g->revolute[l] ? by.L * by.H_R + by.H_P : by.H_R;
    if (g->revolute[l]) *(l < g->k ? &before : &beyond) += step[l];
    if (l >= g->k) V_2 += (g->revolute[l] ? by.L : 1) * step[l];
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
  const Chain *g = s->chain;
  int P = g->P;
  double Omega = 0;
  for (int l = 0; l < g->k; l++)
    if (g->revolute[l]) Omega += step[l];
  if (!(Omega < 0.9)) return 0;
  for (int l = 0; l < P; l++) {
    if (g->level[l]) continue;
    double H_R = between(g, l, step, step, step).H_R, K = 0;
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
  const Chain *g = s->chain;
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

/* Find the largest of the distances d* from c within which F is the only solution, |F - q_0| <= Y: its index, or -1. */
static int only_solution(const Cell *s, const Lane *at, const double *A, const double *B, const double *norms,
                         const double *size, const double *Y) {
  int n = s->chain->n, N = s->chain->N;
  double R[N * N], D[N * N], F[N][N], Z[N][N], near[n], mean[n], reach[n];
  for (int level = 0; level < s->levels; level++) {
    for (int i = 0; i < n; i++) {
      double d = s->near[level * n + i], away = (Y[i] + at->beside[i]) * (1 + s->eps);
      if (!(away <= d)) return -1; /* F is beyond this d*, and beyond the smaller ones */
      near[i] = d + at->beside[i], reach[i] = d + away;
      mean[i] = s->turned < 3 ? Y[i] + 0.5 * reach[i] : near[i]; /* on the straight way to another solution */
    }
    for (int i = 0; i < N * N; i++) R[i] = at->rest[i];
    beside_chart(s, N, N, A, B, at->q, at->wide, near, mean, R);
    for (int i = 0; i < N * N; i++) D[i] = size[i] + R[i], F[i / N][i % N] = 1;
    if (commutator(s, norms, reach, D) && enclose(N, s->eps, (double(*)[N])D, F, Z)) return level;
  }
  return -1;
}

/* F on one box. q_0(u) = q_ref(u) + eta(u) is the start of the way to F, eta linear on the box. c(u) is a continuous
   approximation of F on the whole cell. */
static void one_cell_box(const Cell *s, const Lane *at, const double *A, double C[6][6], long box,
                         const Margins *out) {
  const Chain *g = s->chain;
  int n = g->n, N = g->N, P = g->P, k = s->space.k;
  double eps = s->eps, norms[2 * N], size[N * N], R[N * N], D[N * N], Y[n], closer[n], reach[n], theta[P], eta[P];
  double F[N][N], Z[N][N], B[n * N * N], dJ[n * 6 * N], near[n], limit = INFINITY, square = 0, t = s->tool;
  slopes_at(g, at->q, dJ);
  rows_times_slopes(g, N, N, A, dJ, B);
  for (int i = 0; i < n; i++) near[i] = s->near[i] + at->beside[i]; /* |q - q_0| where |q - c| <= d* */
  for (int i = 0; i < N; i++) norms[2 * i] = norm(A + i * N), norms[2 * i + 1] = norm(A + i * N + 3);
  for (int i = 0; i < N * N; i++) {
    size[i] = 0;
    for (int a = 0; a < k; a++) size[i] += fabs(at->first[a * N * N + i]);
  }
  for (int trial = 0, held = 0; !held; trial++) { /* how far the way may lead: not far, then as far as d* */
    if (trial == 4) return;
    for (int i = 0; i < n; i++) closer[i] = trial < 3 ? fmin(near[i], at->step[i] * (2 << 2 * trial) + 1e-12) : near[i];
    for (int i = 0; i < N * N; i++) R[i] = at->rest[i];
    beside_chart(s, N, N, A, B, at->q, at->wide, closer, closer, R);
    for (int i = 0; i < N * N; i++) D[i] = size[i] + R[i];
    held = distance(s, at, norms, D, closer, Y);
    for (int i = 0; i < n; i++) held = held && Y[i] <= closer[i];
  }
  out->level[box] = only_solution(s, at, A, B, norms, size, Y);
  if (out->level[box] < 0) return;
  for (int i = 0; i < N * N; i++) R[i] = at->rest[i];
  beside_chart(s, N, N, A, B, at->q, at->wide, Y, Y, R);
  for (int i = 0; i < N * N; i++) D[i] = size[i] + R[i];
  if (distance(s, at, norms, D, Y, closer))
    for (int i = 0; i < n; i++) Y[i] = fmin(Y[i], closer[i]);
  for (int i = 0; i < n; i++) {
    reach[i] = (at->wide[i] + Y[i]) * (1 + eps) + 9e-16 * fabs(at->q[i]);
    limit = fmin(limit, fmin(at->q[i] - reach[i] - s->lower[i], s->upper[i] - at->q[i] - reach[i]));
  }
  for (int i = 0; i < N; i++)
    for (int c = 0; c < N; c++) F[i][c] = fabs(A[i * N + c]) + eps;
  if (!enclose(N, eps, (double(*)[N])D, F, Z)) return; /* a right inverse of J */
  out->leaf[box] = leaf_margin_along(s, at, A, C, dJ, Y, out->V ? out->V + box * s->r * n * (2 + k) : 0);
  if (!(out->leaf[box] > 0)) return;
  for (int i = 0; i < n; i++)
    for (int c = 0; c < 6; c++) square += Z[i][c] * Z[i][c];
  angles_of(g, at->q, reach, theta, eta);
  for (int l = 0; l < P; l++)
    if (!g->revolute[l]) t += fabs(theta[l]) + eta[l];
  out->sigma[box] = (1 - eps) / (sqrt(square) * (1 + eps) * (s->turned < 3 ? (t + sqrt(t * t + 4)) / 2 : 1));
  for (int i = 0; i < n; i++) out->reach[box * n + i] = reach[i];
  out->limit[box] = limit;
}

/* ---- LANES boxes ---- */

typedef struct {
  Model *chart, *screws, *J, *w, *label; /* w, P 6, (6 + r) N, r m, r: n_ref' eta */
  Model *W, *V, *eta;                    /* r 6, r n, n: q_0 - q_ref */
  Closure closure;
} Work;

/* Rows (count, high) times models (high, columns), which are down and across apart: slopes, and a bound of what is beside
   them and the value at the centre. */
static void rows_times(const Cell *s, int count, const Lanes *rows, const Model *J, int high, int columns, int down,
                       int across, Lanes *first, Lanes *rest) {
  const Space *g = &s->space;
  int k = g->k;
  for (int i = 0; i < count; i++)
    for (int c = 0; c < columns; c++) {
      Lanes e = all(0);
      for (int m = 1; m < g->M; m++) {
        Lanes v = all(0);
        for (int x = 0; x < high; x++) v += rows[i * high + x] * J[x * down + c * across].p[m];
        if (m > k) e += absolute(v);
        else if (first) first[((m - 1) * count + i) * columns + c] = v;
      }
      for (int x = 0; x < high; x++) {
        const Model *y = J + x * down + c * across;
        e += absolute(rows[i * high + x]) * (y->r + s->eps * size_of(y));
      }
      rest[i * columns + c] = e;
    }
}

/* A (J_V) - 1 at q_0(u): slopes and the rest; and |A (xi, -label)|. */
static void after_A(const Cell *s, const Work *w, const Lanes *A, Lanes *first, Lanes *rest, Lanes *step) {
  const Chain *g = s->chain;
  int N = g->N, M = s->space.M;
  rows_times(s, N, A, w->J, N, N, N, 1, first, rest);
  for (int i = 0; i < N; i++) {
    for (int c = 0; c < N; c++) {
      Lanes v = all(-(i == c));
      for (int x = 0; x < N; x++) v += A[i * N + x] * w->J[x * N + c].p[0];
      rest[i * N + c] += absolute(v);
    }
    Lanes sum = all(0);
    for (int m = 0; m < M; m++) {
      Lanes v = all(0);
      for (int x = 0; x < 6; x++) v += A[i * N + x] * w->closure.xi[x].p[m];
      for (int x = 6; x < N; x++) v -= A[i * N + x] * w->label[x - 6].p[m];
      sum += absolute(v);
    }
    for (int x = 0; x < N; x++) {
      const Model *y = x < 6 ? w->closure.xi + x : w->label + x - 6;
      sum += absolute(A[i * N + x]) * (y->r + s->eps * size_of(y));
    }
    step[i] = sum * (1 + s->eps);
  }
}

/* The derivative of a polynomial of the chart (column c of w) by coordinate a, per metre or radian. */
static void derivative(const Cell *s, const Model *x, int c, int a, const Lanes *h, Model *out) {
  const Space *g = &s->space;
  Lanes unit = 1 / (h[a] * s->widths[a]), r = all(3 * s->blur[c]);
  constant(g, 0, out);
  for (int m = 1; m < g->M; m++) {
    int power = s->powers[a * g->M + m];
    if (power) out->p[s->beneath[a * g->M + m]] = x->p[m] * power * unit;
  }
  for (int f = 0; f < s->F; f++) {
    const int *i = s->fourth + 4 * f;
    Lanes v = all(0);
    for (int y = 0; y < 4; y++)
      if (i[y] == a) v += h[i[(y + 1) % 4]] * h[i[(y + 2) % 4]] * h[i[(y + 3) % 4]];
    r += v * h[a] * (s->rest[f * s->w + c] * (1 + 1e-12));
  }
  finish(g, out);
  out->r = r * unit * (1 + 1e-12) + ROUND * size_of(out);
}

/* w, (r, m): n_ref' dq_ref - dn_ref' eta along the coordinates of the cell, n_ref' times the motion of joints along those
   that symmetries removed, 0 along the others; and bounds of |dn_ref|, (r, m, n). */
static void w_models(const Cell *s, const Model *chart, const Model *eta, const Lanes *h, Model *w, Lanes *steep) {
  const Space *g = &s->space;
  int n = s->chain->n, r = s->r, k = g->k, x = 1 + r;
  Model slope;
  for (int i = 0; i < r * s->m * n; i++) steep[i] = all(0);
  for (int f = 0; f < r; f++)
    for (int a = 0; a < s->m; a++) {
      Model *y = w + f * s->m + a;
      constant(g, 0, y);
      for (int i = 0; i < n && a < k + s->removed; i++) {
        const Model *normal = chart + i * x + 1 + f;
        if (a >= k) {
          double moved = s->along[i * s->removed + a - k];
          if (moved != 0) add(g, y, moved, normal, y);
          continue;
        }
        derivative(s, chart + i * x, i * x, a, h, &slope);
        add_product(g, normal, &slope, 1, y);
        derivative(s, normal, i * x + 1 + f, a, h, &slope);
        add_product(g, &slope, eta + i, -1, y);
        steep[(f * s->m + a) * n + i] = most_of(&slope);
      }
    }
}

/* Entry (i, c) of E, (6, 6): the twists of the coordinates of the task, and the screws of the virtual joints. */
static const Model *twist_at(const Cell *s, const Work *w, int i, int c) {
  return c < s->m ? w->closure.twists[c] + i : w->J + i * s->chain->N + s->chain->n + c - s->m;
}

static int turns_with(const Cell *s, int c) {
  return c >= s->m || moves(s->turn + 3 * c) || s->around[c] != 0 || s->twirl[c] != 0;
}

/* w - W E for one potential, (6,). */
static void residual(const Cell *s, const Work *work, const Model *w, const Model *W, Model *rho) {
  const Space *g = &s->space;
  for (int c = 0; c < 6; c++) {
    if (c < s->m) copy(g, w + c, rho + c);
    else constant(g, 0, rho + c);
    for (int i = 0; i < (turns_with(s, c) ? 6 : 3); i++) add_product(g, W + i, twist_at(s, work, i, c), -1, rho + c);
  }
}

/* |row x - less| for a column x of six models */
static Lanes size_after(const Cell *s, const Lanes *row, const Model **x, double less) {
  double eps = s->eps;
  Lanes e = all(eps);
  for (int m = 0; m < s->space.M; m++) {
    Lanes v = all(m == 0 ? -less : 0);
    for (int i = 0; i < 6; i++) v += row[i] * x[i]->p[m];
    e += absolute(v);
  }
  for (int i = 0; i < 6; i++) e += absolute(row[i]) * (x[i]->r + eps * size_of(x[i]));
  return e;
}

/* A polynomial W' with W' E about w, by W' <- W' + (w - W' E) C from W_c, one degree after the other;
   what is left of it, |w - W' E| and |W' - W_c|, (r, 6) each; |C E - 1|, (6, 6), |C J|, (6, N); and V' = n_ref' - W' J. */
static void potential_models(const Cell *s, const Work *work, const Lanes *W_c, Lanes (*C)[6], Lanes *away, Lanes *left,
                             Lanes *off, Lanes *K_most) {
  const Space *g = &s->space;
  int n = s->chain->n, N = s->chain->N, r = s->r;
  double eps = s->eps;
  Model rho[6];
  for (int f = 0; f < r; f++) {
    Model *W = work->W + 6 * f;
    const Model *w = work->w + f * s->m;
    for (int i = 0; i < 6; i++) {
      constant(g, 0, W + i);
      W[i].p[0] = W_c[f * 6 + i], finish(g, W + i);
    }
    for (int degree = 1; degree < 4; degree++) { /* any polynomial will do: without bounds */
      for (int c = 0; c < 6; c++)
        for (int m = g->starts[degree]; m < g->starts[degree + 1]; m++) {
          Lanes v = c < s->m ? w[c].p[m] : all(0);
          for (int i = 0; i < (turns_with(s, c) ? 6 : 3); i++)
            for (int l = g->first[m]; l < g->first[m + 1]; l++)
              v -= W[i].p[g->left[l]] * twist_at(s, work, i, c)->p[g->right[l]];
          rho[c].p[m] = v;
        }
      for (int i = 0; i < 6; i++)
        for (int c = 0; c < 6; c++)
          for (int m = g->starts[degree]; m < g->starts[degree + 1]; m++) W[i].p[m] += C[c][i] * rho[c].p[m];
    }
    for (int i = 0; i < 6; i++) finish(g, W + i);
    residual(s, work, w, W, rho);
    for (int i = 0; i < 6; i++) {
      left[f * 6 + i] = most_of(rho + i);
      away[f * 6 + i] = (size_of(W + i) - W[i].n[0] + absolute(W[i].p[0] - W_c[f * 6 + i])) * (1 + eps);
    }
    for (int i = 0; i < n; i++) {
      Model *V = work->V + f * n + i;
      copy(g, work->chart + i * (1 + r) + 1 + f, V);
      for (int x = 0; x < 6; x++) add_product(g, W + x, work->J + x * N + i, -1, V);
    }
  }
  for (int i = 0; i < 6; i++) {
    const Model *column[6];
    for (int c = 0; c < 6; c++) {
      for (int x = 0; x < 6; x++) column[x] = twist_at(s, work, x, c);
      off[6 * i + c] = size_after(s, C[i], column, i == c);
    }
    for (int c = 0; c < N; c++) {
      for (int x = 0; x < 6; x++) column[x] = work->J + x * N + c;
      K_most[i * N + c] = size_after(s, C[i], column, 0);
    }
  }
}

/* One lane of models: (count,) centres, (k, count) slopes, (count,) bounds of all else. */
static void lane_of(const Space *g, int l, int count, const Model *x, double *c, double *slopes, double *rest) {
  for (int i = 0; i < count; i++) {
    double e = x[i].r[l];
    for (int m = 1 + g->k; m < g->M; m++) e += fabs(x[i].p[m][l]);
    c[i] = x[i].p[0][l], rest[i] = e;
    for (int j = 0; j < g->k; j++) slopes[j * count + i] = x[i].p[1 + j][l];
  }
}

static void lanes_of(int l, int count, const Lanes *x, double *out) {
  for (int i = 0; i < count; i++) out[i] = x[i][l];
}

static void some_boxes(const Cell *s, const double *U, const double *half, const double *shift, long at, int count,
                       Work *w, const Margins *out) {
  const Chain *g = s->chain;
  const Space *sp = &s->space;
  int n = g->n, N = g->N, P = g->P, r = s->r, k = sp->k, x = 1 + r, m_ = s->m, rows = N + r;
  Lanes u[k], h[k], A[N * N], first[k * N * N], rest[N * N], step[N];
  Lanes W[rows * 6], Wfirst[k * rows * N], Wrest[rows * N], steep[r * m_ * n], C[6][6], W_away[r * 6], rho[r * 6], off[36], K_most[6 * N];
  for (int a = 0; a < k; a++)
    for (int l = 0; l < LANES; l++) {
      long box = at + (l < count ? l : 0);
      u[a][l] = U[box * k + a], h[a][l] = half[box * k + a];
    }
  chart_models(s, u, h, w->chart);
  Model *Q = w->screws + 6 * P; /* n models: q_0 without n_ref between */
  for (int i = 0; i < n; i++) {
    Model *eta = w->eta + i;
    constant(sp, 0, eta);
    for (int a = 0; a <= k; a++)
      for (int l = 0; l < LANES; l++) eta->p[a][l] = shift[((at + (l < count ? l : 0)) * n + i) * (2 + k) + a];
    finish(sp, eta);
    add(sp, w->chart + i * x, 1, eta, Q + i);
  }
  for (int f = 0; f < r; f++) {
    constant(sp, 0, w->label + f);
    for (int i = 0; i < n; i++) add_product(sp, w->chart + i * x + 1 + f, w->eta + i, 1, w->label + f);
  }
  pose_models(s, u, h, w->closure.p, w->closure.x, w->closure.twists);
  chain_models(s, Q, w->screws, &w->closure);
  w_models(s, w->chart, w->eta, h, w->w, steep);
  for (int i = 0; i < N * N; i++) constant(sp, 0, w->J + i);
  for (int l = 0; l < P; l++)
    for (int t = g->first[l]; t < g->first[l + 1]; t++)
      for (int i = 0; i < 6; i++) {
        Model *y = w->J + i * N + g->column[t];
        add(sp, y, g->S[t], w->screws + 6 * l + i, y);
      }
  for (int a = 0; a < r; a++)
    for (int i = 0; i < n; i++) w->J[(6 + a) * N + i] = w->chart[i * x + 1 + a];

  double q[LANES][n], A_[LANES][N * N], C_[LANES][6][6];
  int regular[LANES];
  for (int l = 0; l < LANES; l++) {
    double M[N][N], E[6][6];
    for (int i = 0; i < n; i++) q[l][i] = Q[i].p[0][l];
    for (int i = 0; i < N; i++)
      for (int c = 0; c < N; c++) M[i][c] = w->J[i * N + c].p[0][l];
    for (int i = 0; i < 6; i++)
      for (int c = 0; c < 6; c++) E[i][c] = twist_at(s, w, i, c)->p[0][l];
    regular[l] = invert(N, M, (double(*)[N])A_[l]) && invert(6, E, C_[l]);
    for (int i = 0; i < 36; i++) C[i / 6][i % 6][l] = regular[l] ? C_[l][i / 6][i % 6] : 0;
    for (int i = 0; i < N * N; i++) A[i][l] = regular[l] ? A_[l][i] : 0;
    for (int f = 0; f < r; f++)
      for (int y = 0; y < 6; y++) {
        double e = 0;
        for (int c = 0; c < m_ && regular[l]; c++) e += w->w[f * m_ + c].p[0][l] * C_[l][c][y];
        W[(N + f) * 6 + y][l] = e;
      }
    for (int i = 0; i < N; i++) /* the first columns of A belong to n_ref: now to V too */
      for (int y = 0; y < 6; y++) {
        double e = A[i * N + y][l];
        for (int f = 0; f < r; f++) e += A[i * N + 6 + f][l] * W[(N + f) * 6 + y][l];
        W[i * 6 + y][l] = e;
      }
  }
  after_A(s, w, A, first, rest, step);
  rows_times(s, rows, W, w->J, 6, N, N, 1, Wfirst, Wrest);
  potential_models(s, w, W + N * 6, C, W_away, rho, off, K_most);

  double wide[n], beside[n], step_[N], first_[k * N * N], rest_[N * N];
  double W_[rows * 6], Wfirst_[k * rows * N], Wrest_[rows * N], J_[6 * N], J_most[6 * N], V[r * n], dV[k * r * n];
  double V_rest[r * n], away_[r * 6], rho_[r * 6], off_[36], steep_[r * m_ * n], K_[6 * N];
  for (int l = 0; l < count; l++) {
    long box = at + l;
    const Closure *f = &w->closure;
    Lane lane = {f->sizes[0][l], f->sizes[1][l], f->sizes[2][l], f->trace[l], q[l], wide, step_, beside, first_, rest_, W_, Wfirst_,
                 Wrest_, J_, J_most, K_, V, dV, V_rest, away_, rho_, off_, steep_};
    out->split[box] = 0, out->level[box] = -1, out->leaf[box] = out->sigma[box] = 0, out->limit[box] = -INFINITY;
    double best = -1;
    for (int a = 0; a < k; a++) {
      double cost = 0;
      for (int i = 0; i < n; i++) cost += fabs(Q[i].p[1 + a][l]);
      if (cost > best) best = cost, out->split[box] = a;
    }
    for (int i = 0; i < n; i++) {
      wide[i] = (size_of(Q + i)[l] - fabs(Q[i].p[0][l]) + Q[i].r[l]) * (1 + 1e-12) + 1e-14 * fabs(q[l][i]);
      out->Q[box * n + i] = q[l][i];
    }
    if (!regular[l]) continue;
    for (int i = 0; i < n; i++) beside[i] = shift[(box * n + i) * (2 + k) + 1 + k];
    lanes_of(l, N, step, step_), lanes_of(l, N * N, rest, rest_), lanes_of(l, k * N * N, first, first_);
    lanes_of(l, rows * 6, W, W_), lanes_of(l, k * rows * N, Wfirst, Wfirst_), lanes_of(l, rows * N, Wrest, Wrest_);
    lanes_of(l, r * 6, W_away, away_), lanes_of(l, r * 6, rho, rho_), lanes_of(l, 36, off, off_), lanes_of(l, 6 * N, K_most, K_);
    lanes_of(l, r * m_ * n, steep, steep_), lane_of(sp, l, r * n, w->V, V, dV, V_rest);
    for (int i = 0; i < 6 * N; i++) J_[i] = w->J[i].p[0][l], J_most[i] = most_of(w->J + i)[l];
    one_cell_box(s, &lane, A_[l], C_[l], box, out);
  }
}

/* F on K boxes U +- half, (K, k). On a box it is about q_0 = q_ref + eta, eta linear in t: its value at the centre, its
   slopes, and a bound of |q_0 - c| are the rows of shift, (K, n, 2 + k). */
EXPORT int LEVELLED(cell_bounds)(const Cell *s, long K, const double *U, const double *half, const double *shift,
                                 const Margins *out) {
  const Chain *g = s->chain;
  size_t models = s->w + 6 * g->P + g->n + g->N * g->N + s->r * (s->m + 1 + 6 + g->n) + g->n;
  Model *memory = malloc(models * sizeof(Model));
  Work *w = malloc(sizeof(Work));
  if (memory && w) {
    w->chart = memory, w->screws = memory + s->w, w->J = w->screws + 6 * g->P + g->n, w->w = w->J + g->N * g->N;
    w->label = w->w + s->r * s->m, w->W = w->label + s->r, w->V = w->W + 6 * s->r;
    w->eta = w->V + s->r * g->n;
    for (long i = 0; i < K; i += LANES) some_boxes(s, U, half, shift, i, K - i < LANES ? K - i : LANES, w, out);
  }
  int done = memory && w;
  free(memory), free(w);
  return done;
}
