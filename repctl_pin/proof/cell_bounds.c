/* A cell's function over boxes of poses: see docs/theory.md, "Proved, not sampled", "A cell".

   Compiled together with leaf_margin_bounds.c. The same mathematics as cells.py, one box at a time; but the
   leaf margin is bounded to first order, where NumPy does so to second. */

#pragma GCC optimize("O3") /* reorders no arithmetic */

typedef struct {
  const Problem *chain;
  int k, w, terms, places;                  /* coordinates, n (1 + r), monomials, positions of the cell */
  int terms1, terms2, terms3;               /* monomials that first to third derivatives have */
  double tool, columns;                     /* the tool's distance, the largest column of S */
  const int *parent, *variable;             /* terms */
  const int *pair, *triple, *on;            /* k k, k k k: rows of C2 and C3; k: which of the six coordinates */
  const double *C, *C1, *C2, *C3, *M4;      /* terms w, k terms1 w, pairs terms2 w, triples terms3 w, triples k w */
  const double *widths, *p0, *R0;           /* 6, 3, 3 3: of the cell */
  const double *near, *blur;                 /* n, n: d*, and the rounding of q_ref */
  const double *lower, *upper, *only;        /* n, n, 2 N: limits, linear and angular part of Lambda */
  const double *n_size, *beta_size, *n1_size; /* r, k r, k n r: for the rounding */
} Cell;

typedef struct {
  double *leaf, *center, *sigma, *limit, *center_limit, *Q, *reach;
  int *split, *found;
} Out;

static double norm3(const double *x) { return sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]); }

static void apply_transposed(const double *R, const double *x, double *y) {
  double z[3];
  for (int i = 0; i < 3; i++) z[i] = R[i] * x[0] + R[3 + i] * x[1] + R[6 + i] * x[2];
  for (int i = 0; i < 3; i++) y[i] = z[i];
}

/* J_l(omega) e, and its derivative along d. */
static void left_jacobian(const double *omega, const double *e, const double *d, double *value, double *slope) {
  double square = omega[0] * omega[0] + omega[1] * omega[1] + omega[2] * omega[2], t = sqrt(square);
  double a, b, da, db, c = cos(t), s = sin(t);
  if (t < 0.05) {
    a = 0.5 - square / 24 + square * square / 720, b = 1. / 6 - square / 120 + square * square / 5040;
    da = -1. / 12 + square / 180 - square * square / 6720, db = -1. / 60 + square / 1260 - square * square / 60480;
  } else {
    a = (1 - c) / square, b = (t - s) / (square * t);
    da = (t * s - 2 * (1 - c)) / (square * square), db = ((1 - c) * t - 3 * (t - s)) / (square * square * t);
  }
  double one[3], two[3], d_one[3], de[3], w_de[3], along = omega[0] * d[0] + omega[1] * d[1] + omega[2] * d[2];
  cross(omega, e, one), cross(omega, one, two), cross(d, one, d_one), cross(d, e, de), cross(omega, de, w_de);
  for (int i = 0; i < 3; i++) {
    value[i] = e[i] + a * one[i] + b * two[i];
    slope[i] = da * along * one[i] + a * de[i] + db * along * two[i] + b * (d_one[i] + w_de[i]);
  }
}

/* exp of a rotation vector; omega = 0 is the identity. */
static void rotation(const double *omega, double *E) {
  double t = norm3(omega), a[3] = {0, 0, 1};
  if (t > 1e-12)
    for (int i = 0; i < 3; i++) a[i] = omega[i] / t;
  turn(a, t > 1e-12 ? sin(t) : 0, t > 1e-12 ? cos(t) : 1, E);
}

/* The rotation vector of a rotation by less than half a turn. */
static void logarithm(const double *R, double *omega) {
  double v[3] = {R[7] - R[5], R[2] - R[6], R[3] - R[1]}, s = 0.5 * norm3(v), c = 0.5 * (R[0] + R[4] + R[8] - 1);
  double f = s > 1e-9 ? atan2(s, c) / (2 * s) : 0.5;
  for (int i = 0; i < 3; i++) omega[i] = f * v[i];
}

/* R_1 (base to middle link) and the tool's rotation seen from the middle link, and its place from the base. */
static void placed(const Problem *g, const double *theta, const double *tip, double *R1, double *R2, double *p) {
  double E[9], x[3];
  for (int i = 0; i < 9; i++) R1[i] = R2[i] = i % 4 == 0;
  for (int i = 0; i < 3; i++) p[i] = 0;
  for (int l = 0; l < g->P; l++) {
    double *R = l < g->k ? R1 : R2;
    if (l < g->k) {
      apply(R, g->p + 3 * l, x);
      for (int i = 0; i < 3; i++) p[i] += x[i];
    }
    times(R, g->R + 9 * l, 0, R);
    if (g->revolute[l]) {
      turn(g->a + 3 * l, sin(theta[l]), cos(theta[l]), E);
      times(R, E, 0, R);
    } else if (l < g->k) {
      apply(R, g->a + 3 * l, x);
      for (int i = 0; i < 3; i++) p[i] += theta[l] * x[i];
    }
  }
  for (int i = 0; i < 3; i++) E[i] = g->shift[i] + tip[i];
  apply(R1, E, x);
  for (int i = 0; i < 3; i++) p[i] += x[i];
}

static void joints(const Problem *g, const double *q, const double *half, double *theta, double *eta) {
  for (int l = 0; l < g->P; l++) {
    double t = g->o[l], e = 0;
    for (int s = g->first[l]; s < g->first[l + 1]; s++)
      if (g->column[s] < g->n) t += g->S[s] * q[g->column[s]], e += fabs(g->S[s]) * half[g->column[s]];
    theta[l] = t, eta[l] = e;
  }
}

/* What A J_V has beside 1 and its slopes, on a box of joints, and the rounding of the last rows. */
static void rest_of(const Cell *s, const double *A, const double *J_V, const double *norms, const double *theta,
                    const double *q, const double *half, const double *n_rest, double *R, double *rounding) {
  const Problem *g = s->chain;
  int P = g->P, n = g->n, N = g->N, r = g->r;
  double dummy[P], eta[P], linear[N], angular[N], total = 0, slides = 0, longest = 0, rows[N];
  joints(g, q, half, dummy, eta);
  for (int c = 0; c < N; c++) linear[c] = angular[c] = 0;
  for (int l = 0; l < P; l++) {
    int from = l < g->k ? l + 1 : g->k, to = l < g->k ? g->k : l;
    double H_R = 0, H_P = 0, L = g->reach[l];
    for (int p = from; p < to; p++)
      if (g->revolute[p]) H_R += eta[p];
      else H_P += eta[p], L += fabs(theta[p]) + eta[p];
    double v = g->revolute[l] ? 0.5 * H_R * H_R * L + H_R * H_P : 0.5 * H_R * H_R;
    double o = g->revolute[l] && !g->level[l] ? 0.5 * H_R * H_R : 0;
    for (int t = g->first[l]; t < g->first[l + 1]; t++)
      linear[g->column[t]] += fabs(g->S[t]) * v, angular[g->column[t]] += fabs(g->S[t]) * o;
    total += eta[l];
    if (!g->revolute[l]) slides += fabs(theta[l]) + eta[l];
    if (g->reach[l] > longest) longest = g->reach[l];
  }
  double size = 1 + 2 * total;
  for (int a = 0; a < N; a++)
    rows[a] = g->eps * (a < 3   ? s->columns * (1 + longest + slides) * size
                        : a < 6 ? s->columns * size
                                : s->n_size[a - 6] * (1 + s->terms / 64.));
  for (int a = 0; a < r; a++) rounding[a] = rows[6 + a];
  for (int i = 0; i < N; i++) {
    double tiny = 0;
    for (int a = 0; a < N; a++) tiny += fabs(A[i * N + a]) * rows[a];
    for (int c = 0; c < N; c++) {
      double e = -(i == c), more = tiny + norms[2 * i] * linear[c] + norms[2 * i + 1] * angular[c];
      for (int a = 0; a < N; a++) e += A[i * N + a] * J_V[a * N + c];
      if (c < n)
        for (int a = 0; a < r; a++) more += fabs(A[i * N + 6 + a]) * n_rest[a * n + c];
      R[i * N + c] = fabs(e) + more;
    }
  }
}

/* What the twists of the pose have beside their values and slopes, for each coordinate of the cell; C: of theta. */
static void right_side_rest(const Cell *s, const double *h, const double *theta, const double *q, const double *half,
                            const double *loose, const double *C, double (*xi)[6], const double *tip,
                            const double *turns, double *linear, double *angular) {
  const Problem *g = s->chain;
  int k = s->k;
  double dummy[g->P], eta[g->P], off[g->P], L = s->tool, spread = 0, length = norm3(tip);
  double H = 0, squares = 0, H_R = 0, H_P = 0, spun = 0, tip_move = 0;
  joints(g, q, half, dummy, eta);
  joints(g, q, loose, dummy, off);
  for (int l = 0; l < g->P; l++) {
    double x[3];
    if (l < g->k) {
      if (g->revolute[l]) H += eta[l], squares += eta[l] * eta[l], spun += off[l];
      continue;
    }
    cross(xi[l] + 3, tip, x);
    for (int i = 0; i < 3; i++) x[i] += xi[l][i];
    tip_move += norm3(x) * off[l];
    if (l == g->P - 1) continue;
    if (g->revolute[l]) H_R += eta[l];
    else H_P += eta[l], L += fabs(theta[l]) + eta[l];
  }
  for (int a = 0; a < k; a++) { /* the middle link's rotation, and the tool's way, by each coordinate */
    double turned[3] = {0, 0, 0}, moved[3] = {0, 0, 0}, x[3];
    for (int l = 0; l < g->P; l++) {
      cross(xi[l] + 3, tip, x);
      for (int i = 0; i < 3; i++)
        if (l < g->k) turned[i] += xi[l][3 + i] * C[l * k + a];
        else moved[i] += (x[i] + xi[l][i]) * C[l * k + a];
    }
    spun += h[a] * norm3(turned), tip_move += h[a] * norm3(moved);
    spread += turns[a] * turns[a] * h[a] * h[a];
  }
  spread = sqrt(spread);
  double pairs = 0.5 * (H * H - squares), fast = fmin(H, spun + pairs), bent = fmin(H * H, fast * fast + pairs);
  double tip_rest = 0.5 * H_R * H_R * L + H_R * H_P;
  tip_move += tip_rest;
  for (int a = 0; a < k; a++) {
    double push = s->on[a] < s->places ? s->widths[s->on[a]] : 0;
    double spin_rest = (0.5 * bent + 0.5 * spread * fast + spread * spread / 6 + 1e-10) * turns[a];
    double spin_move = (fast + 0.5 * spread) * turns[a] + spin_rest;
    linear[a] = 0.5 * bent * push + length * spin_rest + tip_rest * turns[a] + tip_move * spin_move +
                g->eps * (1 + 2 * H + 2 * H_R) * (push + (1 + L) * turns[a]);
    angular[a] = spin_rest + g->eps * (1 + 2 * H) * turns[a];
  }
}

/* The leaf margin on a box where J_V is known to first order in k variables, to first order. */
static int margin_of(const Problem *g, int k, const double *h, const double *A_, const double *X_, double X_norm,
                     const double *D_, const double *R_, const double *along_, const double *V_, const double *dV_,
                     const double *rest_, double beta, double *leaf, double *sigma) {
  int n = g->n, N = g->N, r = g->r;
  const double(*A)[N] = (const double(*)[N])A_, (*X)[r] = (const double(*)[r])X_, (*R)[N] = (const double(*)[N])R_;
  const double(*along)[N][N] = (const double(*)[N][N])along_, (*V)[n] = (const double(*)[n])V_;
  const double(*dV)[n][k] = (const double(*)[n][k])dV_, (*rest)[n] = (const double(*)[n])rest_;
  double eps = g->eps, slack = 1 + eps, D[N][N], F[N][N], Y[N][N], DY[N][N], below;
  double loose[r][r], S[r][r], dS[r][r], K[r][r], dX[N][r], wide[n][r], defect = eps;
  for (int i = 0; i < N; i++)
    for (int c = 0; c < N; c++) D[i][c] = D_[i * N + c];
  for (int a = 0; a < r; a++)
    for (int b = 0; b < r; b++) {
      double s = -(a == b), e = 0, both = 0;
      for (int i = 0; i < n; i++) {
        s += V[a][i] * V[b][i], e += rest[a][i] * fabs(V[b][i]);
        both += fabs(X[i][a] * X[i][b]);
      }
      defect += fabs(s);
      loose[a][b] = S[a][b] = e + fabs(s) + eps;
      K[a][b] = eps * both;
    }
  for (int i = 0; i < N; i++) {
    for (int a = 0; a < 6; a++) F[i][a] = fabs(A[i][a]) + eps;
    for (int a = 0; a < r; a++) {
      F[i][6 + a] = eps;
      for (int c = 0; c < N; c++) F[i][6 + a] += R[i][c] * fabs(X[c][a]);
      if (i < n) wide[i][a] = 0;
    }
  }
  for (int j = 0; j < k; j++) {
    for (int a = 0; a < r; a++)
      for (int b = 0; b < r; b++) {
        dS[a][b] = 0;
        for (int i = 0; i < n; i++) dS[a][b] += dV[a][i][j] * V[b][i];
        S[a][b] += h[j] * fabs(dS[a][b]);
      }
    for (int i = 0; i < N; i++)
      for (int b = 0; b < r; b++) {
        double s = 0;
        for (int c = 0; c < N; c++) s -= along[j][i][c] * X[c][b];
        F[i][6 + b] += h[j] * fabs(s);
        if (i < n) {
          for (int a = 0; a < r; a++) s += X[i][a] * dS[a][b];
          wide[i][b] += h[j] * fabs(s);
        }
        dX[i][b] = s;
      }
    for (int a = 0; a < r; a++)
      for (int b = 0; b < r; b++) {
        double s = 0;
        for (int i = 0; i < n; i++) s += X[i][a] * dX[i][b] + X[i][b] * dX[i][a];
        K[a][b] += h[j] * fabs(s);
      }
  }
  if (!enclose(N, eps, D, F, Y, DY)) return 0;
  double size = 0, square = 0, turned = 0, e[r];
  for (int i = 0; i < n; i++) {
    for (int j = 0; j < 6; j++) square += Y[i][j] * Y[i][j];
    for (int b = 0; b < r; b++) {
      e[b] = DY[i][6 + b];
      for (int l = 0; l < N; l++) e[b] += R[i][l] * fabs(X[l][b]);
      for (int a = 0; a < r; a++) e[b] += fabs(X[i][a]) * loose[a][b] + Y[i][6 + a] * S[a][b];
    }
    for (int a = 0; a < r; a++)
      for (int b = 0; b < r; b++)
        K[a][b] += fabs(X[i][a]) * e[b] + e[a] * fabs(X[i][b]) + (wide[i][a] + e[a]) * (wide[i][b] + e[b]);
  }
  for (int a = 0; a < r; a++) {
    for (int b = 0; b < r; b++) turned += S[a][b] * S[a][b];
    for (int i = 0; i < n; i++) {
      double x = rest[a][i];
      for (int j = 0; j < k; j++) x += h[j] * fabs(dV[a][i][j]);
      size += x * x;
    }
  }
  turned = sqrt(turned) * slack;
  if (!(turned < 0.5) || !(defect < 0.01)) return 0;
  size = size * slack / ((1 - turned) * (1 - turned));
  double K_norm = (X_norm * X_norm + spectral(r, r, &K[0][0], &below)) * slack;
  *leaf = (1 - eps) / (sqrt(K_norm * (1 + size * slack)) * (1 + 4 * defect) * slack);
  *sigma = (1 - eps) / (sqrt(square) * slack * beta);
  return 1;
}

static void box_of_poses(const Cell *s, const double *u, const double *h, long at, const Out *out) {
  const Problem *g = s->chain;
  const int P = g->P, n = g->n, N = g->N, r = g->r, k = s->k, w = s->w, x = 1 + g->r;
  const double eps = g->eps;
  out->leaf[at] = out->sigma[at] = out->center[at] = 0, out->found[at] = 0, out->split[at] = 0;
  out->limit[at] = out->center_limit[at] = -INFINITY;

  /* q_ref, n_ref and their derivatives, and bounds of them on the box */
  double T[s->terms], val[w], d1[k][w], d2[k][k][w], two[k][w], three[k][w], one[k][w], moved[w], bend[w];
  T[0] = 1;
  for (int t = 1; t < s->terms; t++) T[t] = T[s->parent[t]] * u[s->variable[t]];
  for (int c = 0; c < w; c++) val[c] = 0;
  for (int t = 0; t < s->terms; t++)
    for (int c = 0; c < w; c++) val[c] += s->C[t * w + c] * T[t];
  for (int a = 0; a < k; a++) {
    for (int c = 0; c < w; c++) d1[a][c] = two[a][c] = three[a][c] = 0;
    for (int t = 0; t < s->terms1; t++)
      for (int c = 0; c < w; c++) d1[a][c] += s->C1[(a * s->terms1 + t) * w + c] * T[t];
  }
  for (int a = 0; a < k; a++)
    for (int b = a; b < k; b++) {
      const double *C = s->C2 + s->pair[a * k + b] * s->terms2 * w;
      for (int c = 0; c < w; c++) d2[a][b][c] = 0;
      for (int t = 0; t < s->terms2; t++)
        for (int c = 0; c < w; c++) d2[a][b][c] += C[t * w + c] * T[t];
      for (int c = 0; c < w; c++) {
        d2[b][a][c] = d2[a][b][c];
        two[a][c] += fabs(d2[a][b][c]) * h[b];
        if (b > a) two[b][c] += fabs(d2[a][b][c]) * h[a];
      }
    }
  for (int a = 0; a < k; a++)
    for (int b = a; b < k; b++)
      for (int d = b; d < k; d++) {
        int which = s->triple[(a * k + b) * k + d];
        const double *C = s->C3 + which * s->terms3 * w, *M = s->M4 + which * k * w;
        double v[w], more[w];
        for (int c = 0; c < w; c++) v[c] = more[c] = 0;
        for (int t = 0; t < s->terms3; t++)
          for (int c = 0; c < w; c++) v[c] += C[t * w + c] * T[t];
        for (int e = 0; e < k; e++)
          for (int c = 0; c < w; c++) more[c] += M[e * w + c] * h[e];
        int i[3] = {a, b, d};
        for (int f = 0; f < 3; f++) { /* each different index once, times the orders of the two others */
          if (f && i[f] == i[f - 1]) continue;
          int y = i[(f + 1) % 3], z = i[(f + 2) % 3];
          double hh = h[y] * h[z] * (y == z ? 1 : 2);
          for (int c = 0; c < w; c++) three[i[f]][c] += (fabs(v[c]) + more[c]) * hh;
        }
      }
  for (int c = 0; c < w; c++) moved[c] = bend[c] = 0;
  for (int a = 0; a < k; a++)
    for (int c = 0; c < w; c++) {
      two[a][c] += three[a][c]; /* sum_b |d2_ab| h_b on the box */
      one[a][c] = fabs(d1[a][c]) + two[a][c];
      moved[c] += one[a][c] * h[a];
      bend[c] += 0.5 * two[a][c] * h[a];
    }

  /* the configuration at the centre, by Newton's method */
  double spread[6] = {0, 0, 0, 0, 0, 0}, omega[3], R_u[9], R_x[9], p_x[3];
  for (int a = 0; a < k; a++) spread[s->on[a]] = s->widths[s->on[a]] * u[a];
  for (int i = 0; i < 3; i++) p_x[i] = s->p0[i] + spread[i], omega[i] = spread[3 + i];
  rotation(omega, R_u);
  times(R_u, s->R0, 0, R_x);
  double q[n], zero[n], theta[P], eta[P], xi[P][6], tip[3], R1[9], R2[9], p[3], M[N][N], A[N][N], J_V[N][N];
  double residual = INFINITY;
  for (int i = 0; i < n; i++) q[i] = val[i * x], zero[i] = 0;
  for (int step = 0; step < 14; step++) {
    double rhs[N], R[9], e[3];
    joints(g, q, zero, theta, eta);
    screws(g, theta, xi, tip);
    placed(g, theta, tip, R1, R2, p);
    times(R1, R2, 0, R);
    times(R_x, R, 1, R);
    logarithm(R, e);
    residual = 0;
    for (int i = 0; i < 3; i++) rhs[i] = p_x[i] - p[i], rhs[3 + i] = e[i];
    for (int a = 0; a < r; a++) {
      rhs[6 + a] = 0;
      for (int i = 0; i < n; i++) rhs[6 + a] -= val[i * x + 1 + a] * (q[i] - val[i * x]);
    }
    for (int i = 0; i < N; i++) residual = fmax(residual, fabs(rhs[i]));
    for (int i = 0; i < N; i++)
      for (int c = 0; c < N; c++) J_V[i][c] = 0;
    for (int l = 0; l < P; l++)
      for (int t = g->first[l]; t < g->first[l + 1]; t++)
        for (int i = 0; i < 6; i++) J_V[i][g->column[t]] += g->S[t] * xi[l][i];
    for (int a = 0; a < r; a++)
      for (int i = 0; i < n; i++) J_V[6 + a][i] = val[i * x + 1 + a];
    for (int i = 0; i < N; i++)
      for (int c = 0; c < N; c++) M[i][c] = J_V[i][c];
    if (!invert(N, M, A)) return;
    if (residual < 1e-10) break;
    apply_transposed(R1, rhs, rhs), apply_transposed(R1, rhs + 3, rhs + 3);
    cross(tip, rhs + 3, e);
    for (int i = 0; i < 3; i++) rhs[i] += e[i];
    double dq[n], largest = 0;
    for (int i = 0; i < n; i++) {
      dq[i] = 0;
      for (int c = 0; c < N; c++) dq[i] += A[i][c] * rhs[c];
      largest = fmax(largest, fabs(dq[i]));
    }
    for (int i = 0; i < n; i++) q[i] += dq[i] * (largest > 0.3 ? 0.3 / largest : 1);
  }
  if (!(residual < 1e-9)) return;
  out->found[at] = 1;
  double center_limit = INFINITY;
  for (int i = 0; i < n; i++)
    center_limit = fmin(center_limit, fmin(q[i] - s->lower[i], s->upper[i] - q[i])), out->Q[at * n + i] = q[i];
  out->center_limit[at] = center_limit;

  /* the right-hand side and its slopes */
  double push[k][3], spin[k][3], E[k][6], rhs[k][N], curl[k][k][3], turns[k];
  for (int a = 0; a < k; a++) {
    turns[a] = 0;
    for (int i = 0; i < 3; i++) push[a][i] = spin[a][i] = 0;
    for (int b = 0; b < k; b++)
      for (int i = 0; i < 3; i++) curl[b][a][i] = 0;
    if (s->on[a] < s->places) {
      double e[3] = {0, 0, 0};
      e[s->on[a]] = s->widths[s->on[a]];
      apply_transposed(R1, e, push[a]);
    } else {
      double e[3] = {0, 0, 0}, d[3], value[3], slope[3];
      e[s->on[a] - s->places] = turns[a] = s->widths[s->on[a]];
      for (int b = 0; b < k; b++)
        if (s->on[b] >= s->places) {
          d[0] = d[1] = d[2] = 0, d[s->on[b] - s->places] = s->widths[s->on[b]];
          left_jacobian(omega, e, d, value, slope);
          apply_transposed(R1, slope, curl[b][a]);
        }
      apply_transposed(R1, value, spin[a]);
    }
    cross(tip, spin[a], E[a]);
    for (int i = 0; i < 3; i++) E[a][i] += push[a][i], E[a][3 + i] = spin[a][i];
    for (int i = 0; i < 6; i++) rhs[a][i] = E[a][i];
    for (int f = 0; f < r; f++) {
      rhs[a][6 + f] = 0;
      for (int i = 0; i < n; i++)
        rhs[a][6 + f] += val[i * x + 1 + f] * d1[a][i * x] - d1[a][i * x + 1 + f] * (q[i] - val[i * x]);
    }
  }
  double J[N][6], dJ[n][N][6], unused[2][N], B[n][N][N], B_u[k][N][N], C[N][k], Pq[n][N][k], along[k][N][N];
  char turning[n][N];
  joints(g, q, zero, theta, eta);
  columns(g, theta, eta, J, dJ, turning, unused[0], unused[1]);
  for (int i = 0; i < N; i++)
    for (int a = 0; a < k; a++) {
      C[i][a] = 0;
      for (int c = 0; c < N; c++) C[i][a] += A[i][c] * rhs[a][c];
    }
  double E_q[n][k][6];
  for (int j = 0; j < n; j++)
    for (int a = 0; a < k; a++)
      for (int i = 0; i < 6; i++) E_q[j][a][i] = 0;
  for (int l = 0; l < P; l++)
    for (int t = g->first[l]; t < g->first[l + 1]; t++) {
      int j = g->column[t];
      if (j >= n) continue;
      for (int a = 0; a < k; a++) {
        double y[3], z[3], e[6] = {0, 0, 0, 0, 0, 0};
        if (l < g->k) { /* the middle link turns against the base */
          cross(spin[a], xi[l] + 3, e + 3);
          cross(push[a], xi[l] + 3, y);
          cross(tip, e + 3, z);
          for (int i = 0; i < 3; i++) e[i] = y[i] + z[i];
        } else { /* the tool moves against the middle link */
          cross(xi[l] + 3, tip, y);
          for (int i = 0; i < 3; i++) y[i] += xi[l][i];
          cross(y, spin[a], e);
        }
        for (int i = 0; i < 6; i++) E_q[j][a][i] += g->S[t] * e[i];
      }
    }
  for (int j = 0; j < n; j++) {
    for (int i = 0; i < N; i++)
      for (int c = 0; c < N; c++) {
        B[j][i][c] = 0;
        if (turning[j][c])
          for (int l = 0; l < 6; l++) B[j][i][c] += A[i][l] * dJ[j][c][l];
      }
    for (int i = 0; i < N; i++)
      for (int a = 0; a < k; a++) {
        double e = 0;
        for (int l = 0; l < 6; l++) e += A[i][l] * E_q[j][a][l];
        for (int f = 0; f < r; f++) e -= A[i][6 + f] * d1[a][j * x + 1 + f];
        Pq[j][i][a] = e;
      }
    for (int c = 0; c < N; c++) {
      int any = 0;
      for (int i = 0; i < N; i++) any |= B[j][i][c] != 0;
      if (!any) continue;
      for (int i = 0; i < N; i++)
        for (int a = 0; a < k; a++) Pq[j][i][a] -= B[j][i][c] * C[c][a];
    }
  }
  double curve[k][N][k], Phi[N];
  for (int b = 0; b < k; b++) {
    for (int i = 0; i < N; i++)
      for (int c = 0; c < N; c++) {
        B_u[b][i][c] = 0;
        if (c < n)
          for (int f = 0; f < r; f++) B_u[b][i][c] += A[i][6 + f] * d1[b][c * x + 1 + f];
        along[b][i][c] = B_u[b][i][c];
      }
    double right[k][N];
    for (int a = 0; a < k; a++) {
      cross(tip, curl[b][a], right[a]);
      for (int i = 0; i < 3; i++) right[a][3 + i] = curl[b][a][i];
      for (int f = 0; f < r; f++) {
        double e = 0;
        for (int i = 0; i < n; i++)
          e += d1[b][i * x + 1 + f] * d1[a][i * x] + val[i * x + 1 + f] * d2[a][b][i * x] -
               d2[a][b][i * x + 1 + f] * (q[i] - val[i * x]) + d1[a][i * x + 1 + f] * d1[b][i * x];
        right[a][6 + f] = e;
      }
    }
    for (int i = 0; i < N; i++)
      for (int a = 0; a < k; a++) {
        double e = 0;
        for (int c = 0; c < N; c++) e += A[i][c] * right[a][c] - B_u[b][i][c] * C[c][a];
        curve[b][i][a] = e;
      }
  }
  for (int j = 0; j < n; j++)
    for (int b = 0; b < k; b++) {
      double f = C[j][b];
      for (int i = 0; i < N; i++) {
        for (int c = 0; c < N; c++) along[b][i][c] += B[j][i][c] * f;
        for (int a = 0; a < k; a++) curve[b][i][a] += Pq[j][i][a] * f;
      }
    }
  double straight[N], norms[2 * N], turned[N][N], p_sum[N][n], lean[n], wide[n], allowed[n], loose[n], half[n], n_rest[r * n];
  for (int i = 0; i < N; i++) {
    Phi[i] = straight[i] = 0;
    for (int a = 0; a < k; a++) {
      straight[i] += fabs(C[i][a]) * h[a];
      for (int b = 0; b < k; b++) Phi[i] += 0.5 * fabs(curve[a][i][b] + curve[b][i][a]) * h[a] * h[b];
    }
    norms[2 * i] = norm3(A[i]), norms[2 * i + 1] = norm3(A[i] + 3);
    for (int c = 0; c < N; c++) {
      turned[i][c] = 0;
      for (int a = 0; a < k; a++) turned[i][c] += fabs(along[a][i][c]) * h[a];
    }
    for (int j = 0; j < n; j++) {
      p_sum[i][j] = 0;
      for (int a = 0; a < k; a++) p_sum[i][j] += fabs(Pq[j][i][a]) * h[a];
    }
  }
  /* the direction that bends F and J_V most */
  double cost[k];
  for (int a = 0; a < k; a++) {
    cost[a] = 0;
    for (int i = 0; i < n; i++) cost[a] += fabs(C[i][a]) * h[a];
    if (cost[a] > cost[out->split[at]]) out->split[at] = a;
  }
  int small = 1;
  for (int i = 0; i < n; i++) {
    lean[i] = fabs(q[i] - val[i * x]) + bend[i * x] + s->blur[i];
    for (int a = 0; a < k; a++) lean[i] += fabs(C[i][a] - d1[a][i * x]) * h[a];
    allowed[i] = s->near[i] - lean[i], wide[i] = (s->near[i] + lean[i]) * (1 + eps);
    if (!(allowed[i] > 0.5 * Phi[i])) small = 0;
    for (int f = 0; f < r; f++) n_rest[f * n + i] = bend[i * x + 1 + f];
  }
  /* n_ref in a gauge with orthonormal columns: n_ref = V U, U upper triangular; A's last columns times U^T */
  double V[r][n], U[r][r], G[r][r], X[N][r], below;
  for (int f = 0; f < r; f++)
    for (int i = 0; i < n; i++) V[f][i] = val[i * x + 1 + f];
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
    if (!(c > 1e-290)) return;
    for (int i = 0; i < n; i++) V[f][i] /= c;
    U[f][f] = c;
  }
  for (int f = 0; f < r; f++) { /* G = U^-1: V = n_ref G */
    G[f][f] = 1 / U[f][f];
    for (int e = f - 1; e >= 0; e--) {
      double c = 0;
      for (int o = e + 1; o <= f; o++) c += U[e][o] * G[o][f];
      G[e][f] = -c / U[e][e];
    }
  }
  for (int i = 0; i < N; i++)
    for (int f = 0; f < r; f++) {
      X[i][f] = 0;
      for (int e = f; e < r; e++) X[i][f] += A[i][6 + e] * U[f][e];
    }
  double X_norm = spectral(n, r, &X[0][0], &below);
  out->center[at] = 1 / below;
  if (!small) return;

  /* F exists: its way beside the straight one stays below Phi / 2 + Z, which fits into d* */
  double R[N][N], D[N][N], F[N][N], Y[N][N], DY[N][N], rounding[r];
  double linear[k], angular[k], beta[k][r], chained[P][k], guess[n];
  for (int l = 0; l < P; l++)
    for (int a = 0; a < k; a++) {
      chained[l][a] = 0;
      for (int t = g->first[l]; t < g->first[l + 1]; t++)
        if (g->column[t] < n) chained[l][a] += g->S[t] * C[g->column[t]][a];
    }
  for (int i = 0; i < n; i++) guess[i] = fmin(allowed[i], Phi[i]);
  for (int pass = 0;; pass++) {
    for (int i = 0; i < n; i++) loose[i] = guess[i];
    for (int i = 0; i < n; i++) half[i] = straight[i] + loose[i];
    rest_of(s, &A[0][0], &J_V[0][0], norms, theta, q, half, n_rest, &R[0][0], rounding);
    right_side_rest(s, h, theta, q, half, loose, &chained[0][0], xi, tip, turns, linear, angular);
    for (int a = 0; a < k; a++)
      for (int f = 0; f < r; f++) {
        double second = 0, tiny = s->beta_size[a * r + f];
        beta[a][f] = 0;
        for (int i = 0; i < n; i++) {
          int c = i * x, d = i * x + 1 + f;
          double n0 = fabs(val[d]) + moved[d];
          second += 2 * bend[d] * one[a][c] + 2 * moved[d] * two[a][c] + n0 * three[a][c] + three[a][d] * s->near[i] +
                    2 * two[a][d] * moved[c] + one[a][d] * 2 * bend[c];
          beta[a][f] += two[a][d] * half[i];
          tiny += s->n1_size[(a * n + i) * r + f] * (s->near[i] + 1);
          tiny += moved[d] * one[a][c] + n0 * two[a][c] + two[a][d] * s->near[i] + one[a][d] * moved[c];
        }
        beta[a][f] += 0.5 * second + eps * (1 + s->terms / 64.) * tiny;
      }
    for (int i = 0; i < N; i++) {
      double load = 0;
      for (int a = 0; a < k; a++) {
        load += (norms[2 * i] * linear[a] + norms[2 * i + 1] * angular[a]) * h[a];
        for (int f = 0; f < r; f++) load += fabs(A[i][6 + f]) * beta[a][f] * h[a];
      }
      for (int c = 0; c < N; c++) {
        double e = R[i][c] + turned[i][c];
        for (int j = 0; j < n; j++) e += fabs(B[j][i][c]) * loose[j];
        load += R[i][c] * straight[c] + e * Phi[c] + fabs(A[i][c]) * 2 * (residual + 1e-11) * (1 + s->tool);
        D[i][c] = e;
        if (c < n) D[i][c] += p_sum[i][c], load += 0.5 * p_sum[i][c] * Phi[c];
      }
      for (int c = 0; c < N; c++) F[i][c] = load + 1e-15;
    }
    if (!enclose(N, eps, D, F, Y, DY)) return;
    int fits = 1, never = 0;
    for (int i = 0; i < n; i++) {
      double away = (0.5 * Phi[i] + Y[i][0]) * (1 + eps);
      if (!(away <= loose[i])) fits = 0;
      if (!(away <= allowed[i])) never = 1;
      guess[i] = fmin(allowed[i], 1.4 * away);
    }
    if (fits) break;
    if (never || pass == 3) return;
  }
  double reach[n], limit = INFINITY;
  for (int i = 0; i < n; i++) {
    double away = 0.5 * Phi[i] + Y[i][0];
    loose[i] = away;
    reach[i] = (straight[i] + away) * (1 + eps) + 9e-16 * fabs(q[i]);
    limit = fmin(limit, fmin(q[i] - reach[i] - s->lower[i], s->upper[i] - q[i] - reach[i]));
    out->reach[at * n + i] = reach[i];
  }

  /* F is the only solution within d* of q_ref */
  for (int i = 0; i < n; i++) half[i] = straight[i] + wide[i];
  rest_of(s, &A[0][0], &J_V[0][0], norms, theta, q, half, n_rest, &R[0][0], rounding);
  for (int i = 0; i < N; i++)
    for (int c = 0; c < N; c++) {
      D[i][c] = R[i][c] + turned[i][c] + norms[2 * i] * s->only[c] + norms[2 * i + 1] * s->only[N + c];
      for (int j = 0; j < n; j++) D[i][c] += fabs(B[j][i][c]) * wide[j];
      F[i][c] = 1;
    }
  if (!enclose(N, eps, D, F, Y, DY)) return;

  /* the margins along F */
  rest_of(s, &A[0][0], &J_V[0][0], norms, theta, q, reach, n_rest, &R[0][0], rounding);
  for (int i = 0; i < N; i++)
    for (int c = 0; c < N; c++) {
      for (int j = 0; j < n; j++) R[i][c] += fabs(B[j][i][c]) * loose[j];
      D[i][c] = R[i][c] + turned[i][c];
    }
  double dV[r][n][k], rest[r][n], t = s->tool;
  for (int f = 0; f < r; f++)
    for (int i = 0; i < n; i++) {
      rest[f][i] = 0;
      for (int a = 0; a < k; a++) dV[f][i][a] = 0;
      for (int e = 0; e <= f; e++) {
        rest[f][i] += fabs(G[e][f]) * (n_rest[e * n + i] + rounding[e]);
        for (int a = 0; a < k; a++) dV[f][i][a] += d1[a][i * x + 1 + e] * G[e][f];
      }
    }
  joints(g, q, reach, theta, eta);
  for (int l = 0; l < P; l++)
    if (!g->revolute[l]) t += fabs(theta[l]) + eta[l];
  if (!margin_of(g, k, h, &A[0][0], &X[0][0], X_norm, &D[0][0], &R[0][0], &along[0][0][0], &V[0][0], &dV[0][0][0],
                 &rest[0][0], (t + sqrt(t * t + 4)) / 2, out->leaf + at, out->sigma + at))
    return;
  out->limit[at] = limit;
}

void cell_bounds(const Cell *s, long K, const double *u, const double *h, const Out *out) {
  for (long i = 0; i < K; i++) box_of_poses(s, u + i * s->k, h + i * s->k, i, out);
}
