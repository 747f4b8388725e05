/* What bounds of the leaf margin over boxes of joints share with those over boxes of poses. */

#ifndef REPCTL_LEAF_MARGIN_BOUNDS_H
#define REPCTL_LEAF_MARGIN_BOUNDS_H

#include <math.h>

typedef struct Problem {
  int P, k, n, N, r, Z, F, F3;
  double eps, beta;
  const double *R, *p, *a, *shift, *reach; /* P 3 3, P 3, P 3, 3, P: link placements, axes, middle, offsets */
  const int *revolute, *level;             /* P, P: level joints keep their axes parallel to the middle link's */
  const int *first, *column;               /* theta = S q + o in compressed rows: P + 1, nonzeros */
  const double *S, *o;                     /* nonzeros, P */
  const double *Zq, *z0;                   /* Z n, Z: arguments z = Zq q - z0 of the features */
  const int *kind, *parent, *variable;     /* F: 0 constant, 1 product, 2 sine, 3 cosine */
  const int *third;                        /* F3: the features that third derivatives are of */
  const double *G, *C, *C3;                /* r n F, r n (n + 1) / 2 F, r n n (n + 1) / 2 F3 */
  const double *T, *T4, *E;                /* r n n n, r n n n n, r n */
  const double *round;                     /* 6 + r */
} Problem;

static inline double norm(const double *x) { return sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]); }

/* Product of a row of an inverse and a twist. */
static inline double dot6(const double *x, const double *d) {
  return x[0] * d[0] + x[1] * d[1] + x[2] * d[2] + x[3] * d[3] + x[4] * d[4] + x[5] * d[5];
}

int invert(int N, double B[N][N], double A[N][N]);
void angles_of(const Problem *g, const double *q, const double *half, double *theta, double *eta);
void remainders_of(const Problem *g, const double *theta, const double *eta, double *linear, double *angular);
void screws(const Problem *g, const double *theta, double (*xi)[6], double *tip);
int bound_potentials(const Problem *g, const double *q, const double *h, const double *arms, double V[g->r][g->n],
               double dV[g->r][g->n][g->n], double rest[g->r][g->n], double *round);
double spectral(int n, int r, const double *X, double *below);
void columns(const Problem *g, const double *theta, const double *eta, double J[g->N][6], double dJ[g->n][g->N][6],
             char turns[g->n][g->N], double *linear, double *angular);
double split_inverse(const Problem *g, double A[g->N][g->N], double V[g->r][g->n], double X[g->n][g->r],
                     double T[g->n][g->r]);
void null_space_sizes(const Problem *g, int k, const double *h, double A[g->N][g->N], double R[g->N][g->N],
                      double dN[k][g->N][g->r], double F[g->N][g->N], double first[g->N][g->r],
                      double rough[g->N][g->r]);
int enclose_null_space(const Problem *g, double D[g->N][g->N], double R[g->N][g->N], double first[g->N][g->r],
                       double rough[g->N][g->r], double F[g->N][g->N], double Y[g->N][g->N], double e[g->n][g->r]);
int enclose(int N, double eps, double D[N][N], double F[N][N], double Y[N][N], double DY[N][N]);
void turn_gauge(int n, int N, int r, int k, double A[N][N], double V[r][n], double dV[r][n][k], double rest[r][n],
                double *round);
void compare(const Problem *g, int k, const double *h, double X[g->n][g->r], double T[g->n][g->r],
             double V[g->r][g->n], double dV[g->r][g->n][k], double rest[g->r][g->n], double defect,
             double dN[k][g->N][g->r], double first[g->N][g->r], double e[g->n][g->r], const double *share,
             double X_norm, double *bound, int *split);

#endif
