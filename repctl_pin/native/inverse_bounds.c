/* Upper bounds of the rows of G_r over boxes of joint space: see docs/theory.md, "The closing radius".

   With A an approximate inverse of J_V at the centre and C the change of frame from the middle link to the task there,
   Z = J_V^-1 [C; 0] solves (A J_V) Z = A [C; 0] =: Z_c, where A J_V = I + sum delta_j B_j + E, |E| <= R:

     Z = Z_c + sum delta_j Z_j + zeta,  Z_j = -B_j Z_c,  zeta = zeta' - E Z_c,
     (A J_V) zeta' = -sum delta_j delta_k B_j Z_k - E sum delta_k Z_k + (A J_V - I) E Z_c.

   A row of G_r is (Z_v, Z_w + Z_v x (d - d_c)), with d the tool as seen from the origin of the screws. */

#include "chain.h"
#include "leaf_margin_bounds.h"

static double dot(const double *x, const double *y) { return x[0] * y[0] + x[1] * y[1] + x[2] * y[2]; }

/* The slopes of the tool in the middle link's frame, and a bound of what they leave out. */
static double tool_slopes(const Chain *g, const double *theta, const double *eta, double (*xi)[6], const double *tip,
                          double (*dd)[3]) {
  const Between by = between(g, g->P - 1, eta, theta, eta);
  double x[3];
  for (int j = 0; j < g->n; j++) dd[j][0] = dd[j][1] = dd[j][2] = 0;
  for (int p = g->k; p < g->P - 1; p++) {
    cross(xi[p] + 3, tip, x);
    for (int t = g->first[p]; t < g->first[p + 1]; t++)
      if (g->column[t] < g->n)
        for (int i = 0; i < 3; i++) dd[g->column[t]][i] += g->S[t] * (x[i] + xi[p][i]);
  }
  return 0.5 * by.H_R * by.H_R * by.L + by.H_R * by.H_P;
}

/* max |v + x_v| + ratio |w + x_w| over x = sum delta_j slope_j, |delta_j| <= h_j, from above: the smaller of two bounds.
   wide bounds |x|; along is filled with the slopes of the sum.
   |v + x| <= sqrt(|v|^2 + 2 v.x + |x|^2) <= |v| + v.x / |v| + |x|^2 / (2 |v|). */
static double most_of(int n, const double *h, double ratio, const double *value, double slope[n][6],
                      const double *wide, double *along) {
  const double v = norm(value) + 1e-150, w = norm(value + 3) + 1e-150;
  double both = 0, apart_v = 0, apart_w = 0;
  for (int j = 0; j < n; j++) {
    const double s = dot(value, slope[j]), t = dot(value + 3, slope[j] + 3);
    along[j] = fabs(s / v + ratio * t / w);
    both += h[j] * along[j], apart_v += h[j] * fabs(s), apart_w += h[j] * fabs(t);
  }
  const double square_v = dot(wide, wide), square_w = dot(wide + 3, wide + 3);
  const double apart = sqrt(v * v + 2 * apart_v + square_v) + ratio * sqrt(w * w + 2 * apart_w + square_w);
  const double sum = v + ratio * w + both + square_v / (2 * v) + ratio * square_w / (2 * w);
  return sum < apart ? sum : apart;
}

typedef struct {
  double ratio;          /* rad per m */
  const double *most;    /* n: what the rows may be */
  double *bound, *value; /* n: of |g_v| + ratio |g_w|, g a row of G */
  int *split;
} Rows;

static void one_box(const Problem *g, const double *q, const double *h, const double *arms, const Rows *rows) {
  const Chain *chain = g->frame;
  const int P = chain->P, n = g->n, N = g->N, r = g->r;
  const double eps = g->eps;
  double theta[P], eta[P], xi[P][6], tip[3], dd[n][3], A[N][N], R[N][N], B[n][N][PADDED(N)], D[N][N], F[N][N], Y[N][N];
  double V[r][n], dV[r][n][n], rest[r][n], round[N], Z[N][6], dZ[n][N][6], first[N][6], rough[N][6], share[n];
  char on[n][N];
  for (int i = 0; i < n; i++) rows->bound[i] = INFINITY, rows->value[i] = 0;
  *rows->split = widest(n, h);
  if (!expand(g, q, h, arms, 1, A, R, B, on, V, dV, rest, round)) return;
  angles_of(chain, q, h, theta, eta);
  screws(chain, theta, xi, tip);
  const double bent = tool_slopes(chain, theta, eta, xi, tip, dd) + eps * g->beta;
  for (int i = 0; i < N; i++) { /* of the twist about the tool */
    const double *x = A[i];
    cross(x, tip, Z[i] + 3);
    for (int k = 0; k < 3; k++) Z[i][k] = x[k], Z[i][3 + k] += x[3 + k];
    for (int c = 0; c < N; c++) F[i][c] = eps;
    for (int k = 3; k < 6; k++) F[i][k] += eps * (norm(x) * g->beta + norm(x + 3)); /* rounding of Z_c */
  }
  for (int i = 0; i < n; i++) rows->value[i] = norm(Z[i]) + rows->ratio * norm(Z[i] + 3);
  deviation(N, n, N, h, R, B, on, D, share);
  for (int j = 0; j < n; j++)
    if (share[j] > share[*rows->split]) *rows->split = j;
  if (!enclose_columns(N, n, 6, 0, eps, h, R, D, B, on, Z, F, dZ, first, rough, Y)) return;

  double moved = bent, shares = 0, worst = 0, grows[n];
  for (int j = 0; j < n; j++) moved += h[j] * norm(dd[j]), shares += share[j], grows[j] = h[j];
  for (int i = 0; i < n; i++) {
    double z[6], wide[6] = {0}, slope[n][6], along[n], x[3];
    for (int k = 0; k < 6; k++) z[k] = Y[i][k] + rough[i][k];
    for (int j = 0; j < n; j++) {
      cross(Z[i], dd[j], x);
      for (int k = 0; k < 6; k++) slope[j][k] = dZ[j][i][k] + (k < 3 ? 0 : x[k - 3]);
      for (int k = 0; k < 6; k++) wide[k] += h[j] * fabs(slope[j][k]);
    }
    const double loose = norm(z) + (rows->ratio > 0 ? rows->ratio * (norm(z + 3) + (norm(wide) + norm(z)) * moved +
                                                                    norm(Z[i]) * bent) : 0);
    const double all = most_of(n, h, rows->ratio, Z[i], slope, wide, along) + loose;
    rows->bound[i] = (all + eps) * (1 + 64 * eps);
    if (all > worst * rows->most[i]) {
      worst = all / rows->most[i];
      for (int j = 0; j < n; j++) grows[j] = h[j] * along[j] + 2 * loose * share[j] / shares;
    }
  }
  *rows->split = 0;
  for (int j = 1; j < n; j++)
    if (grows[j] > grows[*rows->split]) *rows->split = j;
}

EXPORT void inverse_bounds(const Problem *g, long K, const double *Q, const double *half, const double *arms,
                           const double *most, double ratio, double *bound, double *value, int *split) {
  const long n = g->n, size = g->r * (n * n + 2 * n + 1);
  for (long i = 0; i < K; i++) {
    const Rows rows = {ratio, most + i * n, bound + i * n, value + i * n, split + i};
    one_box(g, Q + i * n, half + i * n, arms ? arms + i * size : 0, &rows);
  }
}
