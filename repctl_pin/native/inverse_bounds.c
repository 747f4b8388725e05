/* Upper bounds of the rows of G_r over boxes of joint space: see docs/theory.md, "The closing radius".

   With A an approximate inverse of J_V at the centre and C the changes from the middle links to the task there,
   Z = J_V^-1 [C; 0] solves (A J_V) Z = A [C; 0] =: Z_c, where A J_V = I + sum delta_j B_j + E, |E| <= R:

     Z = Z_c + sum delta_j Z_j + zeta,  Z_j = -B_j Z_c,  zeta = zeta' - E Z_c,
     (A J_V) zeta' = -sum delta_j delta_k B_j Z_k - E sum delta_k Z_k + (A J_V - I) E Z_c.

   A row of G_r has (Z_v, Z_w + Z_v x (d - d_c)) for each frame, with d its tool as seen from the origin of its screws. */

#include "linear_algebra.h"
#include "leaf_margin_bounds.h"

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

/* Bounds of one row of G_r, sums over the frames. */
typedef struct {
  double value;         /* |v| + ratio |w| at the centre */
  double apart, square; /* of the two bounds below: all of one, and what the other adds to first order */
  double loose;         /* what both lack */
} Row;

/* Add max |v + x_v| + ratio |w + x_w| over x = sum delta_j slope_j, |delta_j| <= h_j, from above, by two bounds.
   wide bounds |x|; to along are added the slopes of the sum.
   |v + x| <= sqrt(|v|^2 + 2 v.x + |x|^2) <= |v| + v.x / |v| + |x|^2 / (2 |v|). */
static void add_most(int n, const double *h, double ratio, const double *value, double slope[n][6], const double *wide,
                     double *along, Row *row) {
  const double v = norm(value) + 1e-150, w = norm(value + 3) + 1e-150;
  double apart_v = 0, apart_w = 0;
  for (int j = 0; j < n; j++) {
    const double s = dot(value, slope[j]), t = dot(value + 3, slope[j] + 3);
    along[j] += s / v + ratio * t / w;
    apart_v += h[j] * fabs(s), apart_w += h[j] * fabs(t);
  }
  const double square_v = dot(wide, wide), square_w = dot(wide + 3, wide + 3);
  row->value += v + ratio * w;
  row->apart += sqrt(v * v + 2 * apart_v + square_v) + ratio * sqrt(w * w + 2 * apart_w + square_w);
  row->square += square_v / (2 * v) + ratio * square_w / (2 * w);
}

/* Fill one frame's columns of Z_c, of the twist about its tool, and of their rounding F. Returns a bound of what the slopes dd
   of the tool leave out. */
static double twists(const Problem *g, int f, const double *q, const double *h, double A[g->N][g->N],
                     double Z[g->N][6 * g->frames], double F[g->N][g->N], double (*dd)[3]) {
  const Chain *chain = g->frame + f;
  double theta[chain->P], eta[chain->P], xi[chain->P][6], tip[3];
  angles_of(chain, q, h, theta, eta);
  screws(chain, theta, xi, tip);
  const double bent = tool_slopes(chain, theta, eta, xi, tip, dd) + g->eps * g->beta;
  for (int i = 0; i < g->N; i++) {
    const double *x = A[i] + 6 * f;
    double *z = Z[i] + 6 * f, *round = F[i] + 6 * f;
    cross(x, tip, z + 3);
    for (int k = 0; k < 3; k++) z[k] = x[k], z[3 + k] += x[3 + k];
    for (int k = 3; k < 6; k++) round[k] += g->eps * (norm(x) * g->beta + norm(x + 3));
  }
  return bent;
}

typedef struct {
  const double *ratio;   /* frames: rad per m */
  const double *most;    /* n: what the rows may be */
  double *bound, *value; /* n: sums over the frames of |g_v| + ratio |g_w|, g a row of G */
  int *split;
} Rows;

static void one_box(const Problem *g, const double *q, const double *h, const double *arms, const Rows *rows) {
  const int n = g->n, N = g->N, r = g->r, w = 6 * g->frames;
  const double eps = g->eps;
  double A[N][N], R[N][N], B[n][N][PADDED(N)], D[N][N], F[N][N], Y[N][N], V[r][n], dV[r][n][n], rest[r][n], round[N];
  double Z[N][w], dZ[n][N][w], first[N][w], rough[N][w], share[n];
  double dd[g->frames][n][3], bent[g->frames], moved[g->frames];
  char on[n][N];
  for (int i = 0; i < n; i++) rows->bound[i] = INFINITY, rows->value[i] = 0;
  *rows->split = widest(n, h);
  if (!expand(g, q, h, arms, 1, A, R, B, on, V, dV, rest, round)) return;
  for (int i = 0; i < N; i++)
    for (int c = 0; c < N; c++) F[i][c] = eps;
  for (int f = 0; f < g->frames; f++) {
    bent[f] = moved[f] = twists(g, f, q, h, A, Z, F, dd[f]);
    for (int j = 0; j < n; j++) moved[f] += h[j] * norm(dd[f][j]);
    for (int i = 0; i < n; i++) rows->value[i] += norm(Z[i] + 6 * f) + rows->ratio[f] * norm(Z[i] + 6 * f + 3);
  }
  deviation(N, n, N, h, R, B, on, D, share);
  for (int j = 0; j < n; j++)
    if (share[j] > share[*rows->split]) *rows->split = j;
  if (!enclose_columns(N, n, w, 0, eps, h, R, D, B, on, Z, F, dZ, first, rough, Y)) return;

  double shares = 0, worst = 0, grows[n];
  for (int j = 0; j < n; j++) shares += share[j], grows[j] = h[j];
  for (int i = 0; i < n; i++) {
    Row row = {0};
    double along[n], both = 0;
    for (int j = 0; j < n; j++) along[j] = 0;
    for (int f = 0; f < g->frames; f++) {
      const double *value = Z[i] + 6 * f, ratio = rows->ratio[f];
      double z[6], wide[6] = {0}, slope[n][6], x[3];
      for (int k = 0; k < 6; k++) z[k] = Y[i][6 * f + k] + rough[i][6 * f + k];
      for (int j = 0; j < n; j++) {
        cross(value, dd[f][j], x);
        for (int k = 0; k < 6; k++) slope[j][k] = dZ[j][i][6 * f + k] + (k < 3 ? 0 : x[k - 3]);
        for (int k = 0; k < 6; k++) wide[k] += h[j] * fabs(slope[j][k]);
      }
      row.loose += norm(z);
      if (ratio > 0)
        row.loose += ratio * (norm(z + 3) + (norm(wide) + norm(z)) * moved[f] + norm(value) * bent[f]);
      add_most(n, h, ratio, value, slope, wide, along, &row);
    }
    for (int j = 0; j < n; j++) both += h[j] * fabs(along[j]);
    const double together = row.value + both + row.square;
    const double all = (together < row.apart ? together : row.apart) + row.loose;
    rows->bound[i] = (all + eps) * (1 + 64 * eps);
    if (all > worst * rows->most[i]) {
      worst = all / rows->most[i];
      for (int j = 0; j < n; j++) grows[j] = h[j] * fabs(along[j]) + 2 * row.loose * share[j] / shares;
    }
  }
  *rows->split = 0;
  for (int j = 1; j < n; j++)
    if (grows[j] > grows[*rows->split]) *rows->split = j;
}

EXPORT void inverse_bounds(const Problem *g, long K, const double *Q, const double *half, const double *arms,
                           const double *most, const double *ratio, double *bound, double *value, int *split) {
  const long n = g->n, size = g->r * (n * n + 2 * n + 1);
  for (long i = 0; i < K; i++) {
    const Rows rows = {ratio, most + i * n, bound + i * n, value + i * n, split + i};
    one_box(g, Q + i * n, half + i * n, arms ? arms + i * size : 0, &rows);
  }
}
