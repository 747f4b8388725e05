/* Lower bounds of the leaf margin over boxes of joint space: see docs/theory.md, "Proved, not sampled".

   One box at a time. No rounding is switched: bounds of it are added.

   With J_c = [J; V_c'], V_c the value of V at the centre of a box, and any A about its inverse,

     A J_c - 1 = sum delta_j B_j + E, |E| <= R, |A J_c - 1| <= D = R + sum h_j |B_j|,
     F + D Y <= Y, Y > 0: J_c is regular, |J_c^-1| <= Y with F = |A|.

   The last r columns N of J_c^-1 span the null space of J; they are expanded to second order. Relative to the span of V_c,
   the null space and the span of V are the graphs of linear maps T and P to its complement. With S = (T - P)(I + P'T)^-1

     leaf margin >= 1 / sqrt(1 + |S|^2 (1 + |P|^2)). */

#include "leaf_margin_bounds.h"

#include "linear_algebra.h"

static void screw(const double *R, const double *o, const double *a, int revolute, double *xi) {
  double w[3];
  apply(R, a, w);
  for (int i = 0; i < 3; i++) xi[i] = w[i], xi[3 + i] = 0;
  if (!revolute) return;
  for (int i = 0; i < 3; i++) xi[3 + i] = w[i];
  cross(o, w, xi);
}

/* Move a frame by joint l, forwards or backwards. */
static void move_by(const Chain *g, int l, double theta, int sign, double *R, double *o) {
  double E[9], x[3];
  if (g->revolute[l]) {
    turn(g->a + 3 * l, sign * sin(theta), cos(theta), E);
    times(R, E, 0, R);
    return;
  }
  apply(R, g->a + 3 * l, x);
  for (int i = 0; i < 3; i++) o[i] += sign * theta * x[i];
}

static const double EYE[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};

/* Joint screws (v, omega) in the middle link's frame, and the origin of the last joint. */
void screws(const Chain *g, const double *theta, double (*xi)[6], double *tip) {
  double R[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, o[3], x[3];
  for (int i = 0; i < 3; i++) o[i] = tip[i] = -g->shift[i];
  for (int l = g->k; l < g->P; l++) {
    apply(R, g->p + 3 * l, x);
    for (int i = 0; i < 3; i++) o[i] += x[i];
    times(R, g->R + 9 * l, 0, R);
    for (int i = 0; i < 3; i++) tip[i] = o[i];
    screw(g->level[l] ? EYE : R, o, g->a + 3 * l, g->revolute[l], xi[l]);
    move_by(g, l, theta[l], 1, R, o);
  }
  for (int i = 0; i < 9; i++) R[i] = i % 4 == 0;
  for (int i = 0; i < 3; i++) o[i] = -g->shift[i];
  for (int l = g->k - 1; l >= 0; l--) {
    screw(R, o, g->a + 3 * l, g->revolute[l], xi[l]);
    move_by(g, l, theta[l], -1, R, o);
    times(R, g->R + 9 * l, 1, R);
    apply(R, g->p + 3 * l, x);
    for (int i = 0; i < 3; i++) o[i] -= x[i];
  }
}

/* Invert B (N, N) by Gauss-Jordan elimination with row exchanges; 0 if a pivot vanishes. */
int invert(int N, double B[N][N], double A[N][N]) {
  for (int i = 0; i < N; i++)
    for (int j = 0; j < N; j++) A[i][j] = i == j;
  for (int c = 0; c < N; c++) {
    int best = c;
    for (int i = c + 1; i < N; i++)
      if (fabs(B[i][c]) > fabs(B[best][c])) best = i;
    double pivot = B[best][c];
    if (!(fabs(pivot) > 1e-290)) return 0;
    for (int j = 0; j < N; j++) {
      double x = B[best][j], y = A[best][j];
      B[best][j] = B[c][j], A[best][j] = A[c][j];
      B[c][j] = x / pivot, A[c][j] = y / pivot;
    }
    for (int i = 0; i < N; i++) {
      double f = B[i][c];
      if (i == c || f == 0) continue;
      for (int j = c; j < N; j++) B[i][j] -= f * B[c][j];
      for (int j = 0; j < N; j++) A[i][j] -= f * A[c][j];
    }
  }
  return 1;
}

/* Bound the spectral norm of X (n, r), rows r apart: lambda <= (tr G^256)^(1/256); it is at least r^(-1/512) of this. */
static double spectral(int n, int r, const double *X) {
  double G[r][r], H[r][r], scale = 0, power = 1;
  for (int a = 0; a < r; a++)
    for (int b = 0; b < r; b++) {
      G[a][b] = 0;
      for (int i = 0; i < n; i++) G[a][b] += X[i * r + a] * X[i * r + b];
    }
  for (int t = 0;; t++) {
    double trace = 0;
    for (int a = 0; a < r; a++) trace += G[a][a];
    if (!(trace > 0) || r == 1 || t == 8) return exp(0.5 * (scale + log(trace) / power));
    scale += log(trace) / power;
    power *= 2;
    for (int a = 0; a < r; a++)
      for (int b = 0; b < r; b++) {
        H[a][b] = 0;
        for (int c = 0; c < r; c++) H[a][b] += G[a][c] / trace * (G[c][b] / trace);
      }
    for (int a = 0; a < r; a++)
      for (int b = 0; b < r; b++) G[a][b] = H[a][b];
  }
}

/* Evaluate V, its slopes and the bound of the rest, in a gauge with orthonormal columns. What arm angles add to V, its
   slopes, the rest and the rounding is given, if there are any: n, n n, n and 1 numbers for each potential. */
static int bound_potentials(const Problem *g, const double *q, const double *h, const double *arms,
                            double V[g->r][g->n], double dV[g->r][g->n][g->n], double rest[g->r][g->n], double *round) {
  int n = g->n, r = g->r, F = g->F, m = g->N - r;
  double z[g->Z + 1], phi[F + 1];
  for (int s = 0; s < g->Z; s++) {
    z[s] = -g->z0[s];
    for (int i = 0; i < n; i++) z[s] += g->Zq[s * n + i] * q[i];
  }
  for (int f = 0; f < F; f++) {
    double x = z[g->variable[f]];
    switch (g->kind[f]) {
      case 0: phi[f] = 1; break;
      case 1: phi[f] = phi[g->parent[f]] * x; break;
      case 2: phi[f] = sin(x); break;
      default: phi[f] = cos(x);
    }
  }
  const double *C = g->C, *C3 = g->C3, *T = g->T, *T4 = g->T4;
  for (int a = 0; a < r; a++)
    for (int i = 0; i < n; i++) {
      const double *G = g->G + (a * n + i) * F;
      V[a][i] = 0;
      for (int f = 0; f < F; f++) V[a][i] += G[f] * phi[f];
      for (int j = i; j < n; j++, C += F) {
        double s = 0;
        for (int f = 0; f < F; f++) s += C[f] * phi[f];
        dV[a][i][j] = dV[a][j][i] = s;
      }
      double e = 0;
      for (int j = 0; j < n; j++)
        for (int l = 0; l < n; l++) e += *T++ * (h[j] * h[l]);
      if (g->F3)
        for (int j = 0; j < n; j++)
          for (int l = 0; l < n; l++) {
            double t = 0, s = 0;
            for (int m = 0; m < n; m++) t += *T4++ * h[m];
            if (l >= j)
              for (int f = 0; f < g->F3; f++) s += *C3++ * phi[g->third[f]];
            e += (fabs(s) * (l > j ? 2 : 1) + t / 3) * (h[j] * h[l]);
          }
      rest[a][i] = 0.5 * e + g->E[a * n + i];
    }
  for (int a = 0; a < r; a++) {
    round[m + a] = g->round[m + a];
    if (!arms) continue;
    const double *x = arms + a * (n * n + 2 * n + 1);
    for (int i = 0; i < n; i++) {
      V[a][i] += x[i], rest[a][i] += x[n + n * n + i];
      for (int j = 0; j < n; j++) dV[a][i][j] += x[n + i * n + j];
    }
    round[m + a] += x[2 * n + n * n];
  }
  for (int a = 0; a < r; a++) { /* Gram-Schmidt twice, applied to all that belongs to V */
    for (int b = 0; b < 2 * a; b++) {
      const int one = b % a;
      double s = 0;
      for (int i = 0; i < n; i++) s += V[a][i] * V[one][i];
      for (int i = 0; i < n; i++) {
        V[a][i] -= s * V[one][i];
        rest[a][i] += fabs(s) * rest[one][i];
        for (int j = 0; j < n; j++) dV[a][i][j] -= s * dV[one][i][j];
      }
      round[m + a] += fabs(s) * round[m + one];
    }
    double norm = 0;
    for (int i = 0; i < n; i++) norm += V[a][i] * V[a][i];
    norm = sqrt(norm);
    if (!(norm > 1e-290)) return 0;
    for (int i = 0; i < n; i++) {
      V[a][i] /= norm, rest[a][i] /= norm;
      for (int j = 0; j < n; j++) dV[a][i][j] /= norm;
    }
    round[m + a] /= norm;
  }
  return 1;
}

/* Positions of the joints of the chain at q, and how far they are moved while q is within half of it. */
void angles_of(const Chain *g, const double *q, const double *half, double *theta, double *eta) {
  for (int l = 0; l < g->P; l++) {
    theta[l] = g->o[l], eta[l] = 0;
    for (int t = g->first[l]; t < g->first[l + 1]; t++)
      if (g->column[t] < g->n)
        theta[l] += g->S[t] * q[g->column[t]], eta[l] += fabs(g->S[t]) * half[g->column[t]];
  }
}

Between between(const Chain *g, int l, const double *moved, const double *at, const double *off) {
  const int from = l < g->k ? l + 1 : g->k, to = l < g->k ? g->k : l;
  Between by = {0, 0, g->reach[l]};
  for (int p = from; p < to; p++)
    if (g->revolute[p]) by.H_R += moved[p];
    else by.H_P += moved[p], by.L += fabs(at[p]) + off[p];
  return by;
}

/* Remainders of the columns of J in boxes theta +- eta. */
void remainders_of(const Chain *g, const double *theta, const double *eta, double *linear, double *angular) {
  for (int c = 0; c < g->N; c++) linear[c] = angular[c] = 0;
  for (int l = 0; l < g->P; l++) {
    const Between by = between(g, l, eta, theta, eta);
    double v = g->revolute[l] ? 0.5 * by.H_R * by.H_R * by.L + by.H_R * by.H_P : 0.5 * by.H_R * by.H_R;
    double o = g->revolute[l] && !g->level[l] ? 0.5 * by.H_R * by.H_R : 0;
    for (int t = g->first[l]; t < g->first[l + 1]; t++)
      linear[g->column[t]] += fabs(g->S[t]) * v, angular[g->column[t]] += fabs(g->S[t]) * o;
  }
}

/* Evaluate J of one frame, and its slopes: six rows, which begin at row `at` of the m rows of J. */
void columns(const Chain *g, const double *theta, int at, int m, double J[g->N][m], double dJ[g->n][g->N][m],
             char turns[g->n][g->N]) {
  int n = g->n, k = g->k;
  double xi[g->P][6], tip[3];
  screws(g, theta, xi, tip);
  for (int l = 0; l < g->P; l++) {
    int from = l < k ? l + 1 : k, to = l < k ? k : l;
    double sign = l < k ? -1 : 1;
    for (int p = from; p < to; p++) { /* joints between this one and the middle link */
      double x[3], y[3], d[6]; /* the Lie bracket of the two screws */
      cross(xi[p] + 3, xi[l], x);
      cross(xi[p], xi[l] + 3, y);
      cross(xi[p] + 3, xi[l] + 3, d + 3);
      for (int i = 0; i < 3; i++) d[i] = x[i] + y[i];
      if (g->level[l]) {
        cross(xi[p] + 3, tip, x);
        for (int i = 0; i < 3; i++) x[i] += xi[p][i], d[3 + i] = 0;
        cross(x, xi[l] + 3, d);
      }
      for (int s = g->first[l]; s < g->first[l + 1]; s++)
        for (int t = g->first[p]; t < g->first[p + 1]; t++) {
          int j = g->column[t], c = g->column[s];
          if (j >= n) continue;
          double f = sign * g->S[s] * g->S[t];
          for (int i = 0; i < m && !turns[j][c]; i++) dJ[j][c][i] = 0;
          for (int i = 0; i < 6; i++) dJ[j][c][at + i] += f * d[i];
          turns[j][c] = 1;
        }
    }
    for (int s = g->first[l]; s < g->first[l + 1]; s++)
      for (int i = 0; i < 6; i++) J[g->column[s]][at + i] += g->S[s] * xi[l][i];
  }
}

/* Find Y > 0 with (1 + eps) D Y + F <= (1 - eps) Y: solved with twice the slack, then checked. */
int enclose(int N, double eps, double D[N][N], double F[N][N], double Y[N][N]) {
  double M[N][N];
  for (int i = 0; i < N; i++)
    for (int j = 0; j < N; j++) {
      M[i][j] = (i == j ? 1 - 2 * eps : 0) - (1 + eps) * D[i][j];
      Y[i][j] = F[i][j];
    }
  for (int c = 0; c < N; c++) {
    if (!(M[c][c] > 1e-12)) return 0;
    for (int i = c + 1; i < N; i++) {
      double f = M[i][c] / M[c][c];
      for (int j = c + 1; j < N; j++) M[i][j] -= f * M[c][j];
      for (int j = 0; j < N; j++) Y[i][j] -= f * Y[c][j];
    }
  }
  for (int c = N - 1; c >= 0; c--) {
    for (int i = c + 1; i < N; i++)
      for (int j = 0; j < N; j++) Y[c][j] -= M[c][i] * Y[i][j];
    for (int j = 0; j < N; j++) Y[c][j] /= M[c][c];
  }
  for (int i = 0; i < N; i++) {
    double DY[N];
    for (int j = 0; j < N; j++) DY[j] = 0;
    for (int l = 0; l < N; l++)
      for (int j = 0; j < N; j++) DY[j] += D[i][l] * Y[l][j];
    for (int j = 0; j < N; j++)
      if (!(Y[i][j] > 0) || !((1 + eps) * DY[j] + F[i][j] <= (1 - eps) * Y[i][j])) return 0;
  }
  return 1;
}

/* out += x y, and out += x |y|, of padded columns. */
static inline void add_times(int N, double x, const double *y, double *out) {
  for (int b = 0; b < N; b += 4)
    for (int i = b; i < b + 4; i++) out[i] += x * y[i];
}

static inline void add_sizes(int N, double x, const double *y, double *out) {
  for (int b = 0; b < N; b += 4)
    for (int i = b; i < b + 4; i++) out[i] += x * fabs(y[i]);
}

/* Expand J_V about the centre of a box, by A about its inverse: A, the bound R, the slopes B by columns, of which those
   are on that are not 0; V, its slopes, its rest and rounding. For J_V if whole, else with V_c in place of V. 0 without an
   inverse. */
int expand(const Problem *g, const double *q, const double *h, const double *arms, int whole, double A[g->N][g->N],
           double R[g->N][g->N], double B[g->n][g->N][PADDED(g->N)], char on[g->n][g->N],
           double V[g->r][g->n], double dV[g->r][g->n][g->n], double rest[g->r][g->n], double *round) {
  int n = g->n, N = g->N, r = g->r, frames = g->frames, m = N - r;
  double J[N][m], dJ[n][N][m], M[N][N], linear[frames][N], angular[frames][N], A_T[N][PADDED(N)];
  memset(J, 0, sizeof J), memset(on, 0, n * N);
  for (int f = 0; f < frames; f++) {
    const Chain *chain = g->frame + f;
    double theta[chain->P], eta[chain->P];
    angles_of(chain, q, h, theta, eta);
    columns(chain, theta, 6 * f, m, J, dJ, on);
    remainders_of(chain, theta, eta, linear[f], angular[f]);
  }
  for (int i = 0; i < m; i++) round[i] = g->round[i];
  if (!bound_potentials(g, q, h, arms, V, dV, rest, round)) return 0;
  for (int c = 0; c < N; c++) {
    for (int a = 0; a < m; a++) M[a][c] = J[c][a];
    for (int a = 0; a < r; a++) M[m + a][c] = c < n ? V[a][c] : 0;
  }
  if (!invert(N, M, A)) return 0;
  for (int i = 0; i < N; i++) {
    double tiny = 0;
    for (int a = 0; a < N; a++) tiny += fabs(A[i][a]) * round[a];
    for (int c = 0; c < N; c++) {
      double s = -(i == c), e = tiny;
      for (int f = 0; f < frames; f++) {
        const double *x = A[i] + 6 * f;
        s += dot6(x, J[c] + 6 * f), e += norm(x) * linear[f][c] + norm(x + 3) * angular[f][c];
      }
      for (int a = 0; a < r && c < n; a++) {
        s += A[i][m + a] * V[a][c];
        if (whole) e += fabs(A[i][m + a]) * rest[a][c];
      }
      R[i][c] = e + fabs(s);
    }
  }
  memset(A_T, 0, sizeof A_T);
  for (int i = 0; i < N; i++)
    for (int a = 0; a < N; a++) A_T[a][i] = A[i][a];
  for (int j = 0; j < n; j++)
    for (int c = 0; c < N; c++) {
      const int moves = on[j][c] && h[j] != 0, turns = whole && c < n && h[j] != 0;
      on[j][c] = moves || turns;
      if (!on[j][c]) continue;
      memset(B[j][c], 0, sizeof B[j][c]);
      for (int a = 0; a < m && moves; a++) add_times(N, dJ[j][c][a], A_T[a], B[j][c]);
      for (int a = 0; a < r && turns; a++) add_times(N, dV[a][c][j], A_T[m + a], B[j][c]);
    }
  return 1;
}

/* D = R + sum h_j |B_j|, and the share of each variable in it, in the first rows. */
void deviation(int N, int k, int rows, const double *h, double R[N][N], double B[k][N][PADDED(N)], char on[k][N],
               double D[N][N], double *share) {
  double sum[N][PADDED(N)];
  memset(sum, 0, sizeof sum);
  for (int j = 0; j < k; j++) {
    share[j] = 0;
    for (int c = 0; c < N; c++) {
      if (!on[j][c]) continue;
      add_sizes(N, h[j], B[j][c], sum[c]);
      for (int i = 0; i < rows; i++) share[j] += h[j] * fabs(B[j][c][i]);
    }
  }
  for (int i = 0; i < N; i++)
    for (int c = 0; c < N; c++) D[i][c] = R[i][c] + sum[c][i];
}

/* Enclose Z = (A J_V)^-1 Z_c, w columns, on a box: Z = Z_c + sum delta_j Z_j + zeta, Z_j = -B_j Z_c, where first bounds the
   sum, and |zeta| <= rough + Y, in the columns of F and Y that begin at `at`. In F is what has no bound of second order. */
int enclose_columns(int N, int k, int w, int at, double eps, const double *h, double R[N][N], double D[N][N],
                    double B[k][N][PADDED(N)], char on[k][N], double Z[N][w], double F[N][N], double dZ[k][N][w],
                    double first[N][w], double rough[N][w], double Y[N][N]) {
  double S[w][PADDED(N)], second[w][PADDED(N)];
  memset(second, 0, sizeof second);
  for (int j = 0; j < k; j++) {
    memset(S, 0, sizeof S);
    for (int c = 0; c < N; c++)
      for (int a = 0; a < w && on[j][c]; a++) add_times(N, -Z[c][a], B[j][c], S[a]);
    for (int i = 0; i < N; i++)
      for (int a = 0; a < w; a++) dZ[j][i][a] = S[a][i];
  }
  for (int j = 0; j < k; j++) /* second order: |B_j Z_l + B_l Z_j| for j < l, |B_j Z_j| */
    for (int l = j; l < k; l++) {
      const double both = h[j] * h[l];
      if (both == 0) continue;
      memset(S, 0, sizeof S);
      for (int c = 0; c < N; c++) {
        for (int a = 0; a < w && on[j][c]; a++) add_times(N, dZ[l][c][a], B[j][c], S[a]);
        for (int a = 0; a < w && on[l][c] && l > j; a++) add_times(N, dZ[j][c][a], B[l][c], S[a]);
      }
      for (int a = 0; a < w; a++) add_sizes(N, both, S[a], second[a]);
    }
  for (int i = 0; i < N; i++)
    for (int a = 0; a < w; a++) {
      first[i][a] = rough[i][a] = 0;
      for (int j = 0; j < k; j++) first[i][a] += h[j] * fabs(dZ[j][i][a]);
      for (int c = 0; c < N; c++) rough[i][a] += R[i][c] * fabs(Z[c][a]);
    }
  for (int i = 0; i < N; i++)
    for (int a = 0; a < w; a++) {
      F[i][at + a] += second[a][i];
      for (int c = 0; c < N; c++) F[i][at + a] += R[i][c] * first[c][a] + D[i][c] * rough[c][a];
    }
  return enclose(N, eps, D, F, Y);
}

static void rotate(double c, double s, double *x, double *y) {
  const double a = *x, b = *y;
  *x = c * a - s * b, *y = s * a + c * b;
}

/* Diagonalise the symmetric G (r, r) by Jacobi's rotations; the columns of O are orthonormal to rounding. */
static void axes(int r, double G[r][r], double O[r][r]) {
  for (int a = 0; a < r; a++)
    for (int b = 0; b < r; b++) O[a][b] = a == b;
  for (int sweep = 0; sweep < 12; sweep++)
    for (int a = 0; a < r; a++)
      for (int b = a + 1; b < r; b++) {
        if (!(fabs(G[a][b]) > 1e-16 * (fabs(G[a][a]) + fabs(G[b][b])))) continue;
        double x = (G[b][b] - G[a][a]) / (2 * G[a][b]);
        double t = (x < 0 ? -1 : 1) / (fabs(x) + sqrt(x * x + 1)), c = 1 / sqrt(t * t + 1), s = t * c;
        for (int i = 0; i < r; i++) rotate(c, s, &G[i][a], &G[i][b]), rotate(c, s, &O[i][a], &O[i][b]);
        for (int i = 0; i < r; i++) rotate(c, s, &G[a][i], &G[b][i]);
      }
}

/* x <- O' x, or |O'| x for bounds, of r numbers that are `apart` from each other. */
static void turn_by(int r, double O[r][r], int bounds, int apart, double *x) {
  double y[r];
  for (int a = 0; a < r; a++) y[a] = x[a * apart], x[a * apart] = 0;
  for (int a = 0; a < r; a++)
    for (int b = 0; b < r; b++) x[a * apart] += (bounds ? fabs(O[b][a]) : O[b][a]) * y[b];
}

/* Turn the gauge of V, and of all that belongs to it, so that T'T is diagonal, T = X - V at the centre. */
static void turn_gauge(int n, int N, int r, int k, double A[N][N], double V[r][n], double dV[r][n][k],
                       double rest[r][n]) {
  int m = N - r;
  double G[r][r], O[r][r];
  for (int a = 0; a < r; a++)
    for (int b = 0; b < r; b++) {
      G[a][b] = 0;
      for (int i = 0; i < n; i++) G[a][b] += (A[i][m + a] - V[a][i]) * (A[i][m + b] - V[b][i]);
    }
  axes(r, G, O);
  for (int i = 0; i < N; i++) turn_by(r, O, 0, 1, A[i] + m);
  for (int i = 0; i < n; i++) {
    turn_by(r, O, 0, n, V[0] + i), turn_by(r, O, 1, n, rest[0] + i);
    for (int j = 0; j < k; j++) turn_by(r, O, 0, n * k, dV[0][i] + j);
  }
}

/* From the slopes dN of the null space and those of V in k variables, across V_c: the bound of the leaf margin, and
   where to split.
   P = W'V (V_c'V)^-1 and T = W'N for the complement W of V_c; S = (T - P) (I + P'T)^-1. */
static void compare(int n, int N, int r, int k, double eps, const double *h, double X[N][r], double T[n][r],
                    double V[r][n], double dV[r][n][k], double rest[r][n], double defect, double dN[k][N][r],
                    double first[N][r], double e[n][r], const double *share, double X_norm, double *bound, int *split) {
  double slack = 1 + eps, dP[n][r], PT[r][r], both[r][r], M[r][r], part[k];
  double all[n][r], loose[n][r], wide[n][r], b[r][r], bent[r][r], K[r][r], sum = 0, size = 0, turned = 0;
  for (int a = 0; a < r; a++)
    for (int c = 0; c < r; c++) {
      double s = defect;
      for (int i = 0; i < n; i++) s += rest[a][i] * fabs(V[c][i]);
      M[a][c] = s, b[a][c] = K[a][c] = 0;
    }
  for (int i = 0; i < n; i++)
    for (int a = 0; a < r; a++) all[i][a] = wide[i][a] = 0;
  for (int j = 0; j < k; j++) {
    part[j] = 0;
    if (h[j] == 0) continue;
    for (int a = 0; a < r; a++)
      for (int i = 0; i < n; i++) dP[i][a] = dV[a][i][j], sum += h[j] * fabs(dV[a][i][j]);
    for (int a = 0; a < r; a++)
      for (int c = 0; c < r; c++) {
        double s = 0;
        for (int i = 0; i < n; i++) s += V[c][i] * dV[a][i][j];
        for (int i = 0; i < n; i++) dP[i][a] -= V[c][i] * s;
        M[a][c] += h[j] * fabs(s);
      }
    for (int a = 0; a < r; a++)
      for (int c = 0; c < r; c++) {
        PT[a][c] = 0;
        for (int i = 0; i < n; i++) PT[a][c] += dP[i][a] * T[i][c];
        b[a][c] += h[j] * fabs(PT[a][c]);
      }
    for (int a = 0; a < r; a++)
      for (int c = 0; c < r; c++) both[a][c] = 0;
    for (int i = 0; i < n; i++)
      for (int a = 0; a < r; a++) {
        double s = dN[j][i][a] - dP[i][a];
        for (int c = 0; c < r; c++) s -= T[i][c] * PT[c][a];
        all[i][a] += h[j] * fabs(dP[i][a]), wide[i][a] += h[j] * fabs(s);
        for (int c = 0; c < r; c++) both[c][a] += T[i][c] * s;
      }
    for (int a = 0; a < r; a++)
      for (int c = 0; c < r; c++) {
        double s = h[j] * fabs(both[a][c] + both[c][a]);
        K[a][c] += s, part[j] += s * s;
      }
  }
  for (int a = 0; a < r; a++)
    for (int c = 0; c < r; c++) turned += M[a][c] * M[a][c];
  turned = sqrt(turned) * slack;
  if (!(turned < 0.5) || !(defect < 0.01)) return;
  for (int i = 0; i < n; i++) { /* P beside its slopes, and all of P */
    double row = 0;
    for (int a = 0; a < r; a++) {
      double s = rest[a][i] + defect * (1 + sum);
      for (int c = 0; c < r; c++)
        for (int l = 0; l < n; l++) s += fabs(V[c][i]) * fabs(V[c][l]) * rest[a][l];
      loose[i][a] = s;
      row += (all[i][a] + s) * (all[i][a] + s);
    }
    row = sqrt(row) * turned / (1 - turned) * slack;
    for (int a = 0; a < r; a++) loose[i][a] += row, all[i][a] += loose[i][a];
  }
  double norm = 0;
  for (int a = 0; a < r; a++) /* bent: P'T beside its slopes; b: all of it */
    for (int c = 0; c < r; c++) {
      double s = defect;
      for (int i = 0; i < n; i++) s += all[i][a] * (first[i][c] + e[i][c]) + loose[i][a] * fabs(T[i][c]);
      bent[a][c] = s, b[a][c] += s;
      norm += b[a][c] * b[a][c];
    }
  norm = sqrt(norm) * slack;
  if (!(norm < 0.9)) return;
  double second = 0;
  for (int i = 0; i < n; i++) { /* e: S beside its slopes */
    double m[r], w[r], row = 0;
    for (int a = 0; a < r; a++) {
      m[a] = e[i][a] + loose[i][a] + defect;
      for (int c = 0; c < r; c++) m[a] += fabs(T[i][c]) * bent[c][a];
    }
    for (int a = 0; a < r; a++) {
      w[a] = 0;
      for (int c = 0; c < r; c++) w[a] += (wide[i][c] + m[c]) * b[c][a];
      row += w[a] * w[a];
    }
    row = sqrt(row) * norm / (1 - norm) * slack;
    for (int a = 0; a < r; a++) {
      e[i][a] = m[a] + w[a] + row + eps;
      second += e[i][a] * e[i][a];
    }
  }
  for (int a = 0; a < r; a++)
    for (int c = 0; c < r; c++) {
      double s = 0, t = 0, tiny = 1;
      for (int i = 0; i < n; i++) {
        s += T[i][a] * T[i][c], tiny += fabs(X[i][a] * X[i][c]);
        t += fabs(T[i][a]) * e[i][c] + e[i][a] * fabs(T[i][c]) + (wide[i][a] + e[i][a]) * (wide[i][c] + e[i][c]);
      }
      K[a][c] += fabs(s) + t + eps * tiny;
    }
  size = spectral(n, r, &all[0][0]) * slack;
  double most = spectral(r, r, &K[0][0]) * slack;
  *bound = (1 - eps) / (sqrt(1 + most * (1 + size * size * slack)) * (1 + 16 * defect) * slack);
  double shares = 0;
  int best = 0;
  for (int j = 0; j < k; j++) shares += share[j];
  for (int j = 0; j < k; j++) {
    part[j] = 0.5 * sqrt(part[j]) / X_norm + 2 * sqrt(second) * share[j] / shares;
    if (part[j] > part[best]) best = j;
  }
  *split = best;
}

/* The leaf margin on a box where A [J; V_c'] - 1 is known to first order in k variables: its slopes B, and the bound R of all
   else. The last columns of A belong to V. Y bounds the inverse; 0 if there is none. */
int margin_on(int n, int N, int r, int k, double eps, const double *h, double A[N][N], double R[N][N],
              double B[k][N][PADDED(N)], char on[k][N], double V[r][n], double dV[r][n][k], double rest[r][n], double Y[N][N],
              double *bound, double *center, int *split) {
  int m = N - r;
  double D[N][N], F[N][N], X[N][r], T[n][r], dN[k][N][r], first[N][r], rough[N][r], e[n][r], share[k];
  double defect = eps;
  *bound = 0;
  if (r > 1) turn_gauge(n, N, r, k, A, V, dV, rest);
  for (int i = 0; i < N; i++)
    for (int c = 0; c < N; c++) {
      F[i][c] = (c < m ? fabs(A[i][c]) : 0) + eps;
      if (c >= m) X[i][c - m] = A[i][c];
    }
  for (int a = 0; a < r; a++)
    for (int i = 0; i < n; i++) T[i][a] = X[i][a] - V[a][i];
  for (int a = 0; a < r; a++) /* by how much V differs from orthonormal, and X from V'X = 1 */
    for (int b = 0; b < r; b++) {
      double s = -(a == b), t = -(a == b);
      for (int i = 0; i < n; i++) s += V[a][i] * V[b][i], t += V[a][i] * X[i][b];
      defect += fabs(s) + fabs(t);
    }
  double X_norm = spectral(n, r, &X[0][0]);
  *center = pow(r, 1. / 512) / X_norm;
  deviation(N, k, n, h, R, B, on, D, share);
  for (int a = 0; a < r; a++) { /* V's own part of the shares */
    double x = 0;
    for (int i = 0; i < n; i++) x += fabs(X[i][a]);
    for (int i = 0; i < n; i++)
      for (int j = 0; j < k; j++) share[j] += h[j] * x * fabs(dV[a][i][j]);
  }
  for (int j = 0; j < k; j++)
    if (share[j] > share[*split]) *split = j;
  if (!enclose_columns(N, k, r, m, eps, h, R, D, B, on, X, F, dN, first, rough, Y)) return 0;
  for (int i = 0; i < n; i++)
    for (int a = 0; a < r; a++) e[i][a] = rough[i][a] + Y[i][m + a];
  compare(n, N, r, k, eps, h, X, T, V, dV, rest, defect, dN, first, e, share, X_norm, bound, split);
  return 1;
}

int widest(int n, const double *h) {
  int best = 0;
  for (int j = 1; j < n; j++)
    if (h[j] > h[best]) best = j;
  return best;
}

static void one_box(const Problem *g, const double *q, const double *h, const double *arms, double *bound,
                    double *center, double *sigma, int *split) {
  int n = g->n, N = g->N, r = g->r, m = N - r;
  double A[N][N], R[N][N], B[n][N][PADDED(N)], Y[N][N], V[r][n], dV[r][n][n], rest[r][n], round[N], square = 0;
  char on[n][N];
  *bound = *center = *sigma = 0, *split = widest(n, h);
  if (!expand(g, q, h, arms, 0, A, R, B, on, V, dV, rest, round)) return;
  for (int a = 0; a < r; a++)
    for (int i = 0; i < n; i++) rest[a][i] += round[m + a];
  if (!margin_on(n, N, r, n, g->eps, h, A, R, B, on, V, dV, rest, Y, bound, center, split)) return;
  for (int i = 0; i < n; i++)
    for (int c = 0; c < m; c++) square += Y[i][c] * Y[i][c];
  *sigma = (1 - g->eps) / (sqrt(square) * (1 + g->eps) * g->beta);
}

EXPORT void leaf_margins(const Problem *g, long K, const double *Q, const double *half, const double *arms,
                         double *bound, double *center, double *sigma, int *split) {
  long size = g->r * (g->n * g->n + 2 * g->n + 1);
  for (long i = 0; i < K; i++)
    one_box(g, Q + i * g->n, half + i * g->n, arms ? arms + i * size : 0, bound + i, center + i, sigma + i, split + i);
}

/* D on boxes, (K, N, N); unchanged where there is no inverse at the centre. */
EXPORT void deviations(const Problem *g, long K, const double *Q, const double *half, const double *arms, double *D) {
  int n = g->n, N = g->N, r = g->r;
  double A[N][N], R[N][N], B[n][N][PADDED(N)], V[r][n], dV[r][n][n], rest[r][n], round[N], share[n];
  char on[n][N];
  for (long i = 0; i < K; i++) {
    const double *h = half + i * n, *of_arms = arms ? arms + i * r * (n * n + 2 * n + 1) : 0;
    if (expand(g, Q + i * n, h, of_arms, 1, A, R, B, on, V, dV, rest, round))
      deviation(N, n, N, h, R, B, on, (double(*)[N])(D + i * N * N), share);
  }
}
