/* What bounds over boxes of joints share with each other, and with those over boxes of poses. */

#ifndef REPCTL_LEAF_MARGIN_BOUNDS_H
#define REPCTL_LEAF_MARGIN_BOUNDS_H

#include <math.h>
#include <string.h>

/* The extended chain of one frame. */
typedef struct Chain {
  int P, k, n, N;
  const double *R, *p, *a, *shift, *reach; /* P 3 3, P 3, P 3, 3, P: link placements, axes, middle, offsets */
  const int *revolute, *level;             /* P, P: level joints keep their axes parallel to the middle link's */
  const int *first, *column;               /* theta = S q + o in compressed rows: P + 1, nonzeros */
  const double *S, *o;                     /* nonzeros, P */
} Chain;

typedef struct Problem {
  int frames, n, N, r, Z, F, F3;           /* N = 6 frames + r */
  double eps, beta;
  const Chain *frame;                      /* frames */
  const double *Zq, *z0;                   /* Z n, Z: arguments z = Zq q - z0 of the features */
  const int *kind, *parent, *variable;     /* F: 0 constant, 1 product, 2 sine, 3 cosine */
  const int *third;                        /* F3: the features that third derivatives are of */
  const double *G, *C, *C3;                /* r n F, r n (n + 1) / 2 F, r n n (n + 1) / 2 F3 */
  const double *T, *T4, *E;                /* r n n n, r n n n n, r n */
  const double *round;                     /* N */
} Problem;

static inline double norm(const double *x) { return sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]); }

/* What lies between joint l and the middle link while its joints are moved: angles H_R, slides H_P, and the farthest that
   joint l comes from the middle link, L, with slides within off of at. */
typedef struct {
  double H_R, H_P, L;
} Between;
Between between(const Chain *g, int l, const double *moved, const double *at, const double *off);

/* Product of six numbers of a row of an inverse and a twist. */
static inline double dot6(const double *x, const double *d) {
  return x[0] * d[0] + x[1] * d[1] + x[2] * d[2] + x[3] * d[3] + x[4] * d[4] + x[5] * d[5];
}

/* Slopes B_j are stored by columns, with zeros up to a multiple of four. */
#define PADDED(N) (((N) + 3) / 4 * 4)

int invert(int N, double B[N][N], double A[N][N]);
int widest(int n, const double *h);
void angles_of(const Chain *g, const double *q, const double *half, double *theta, double *eta);
void remainders_of(const Chain *g, const double *theta, const double *eta, double *linear, double *angular);
void screws(const Chain *g, const double *theta, double (*xi)[6], double *tip);
void columns(const Chain *g, const double *theta, int at, int m, double J[g->N][m], double dJ[g->n][g->N][m],
             char turns[g->n][g->N]);
int expand(const Problem *g, const double *q, const double *h, const double *arms, int whole, double A[g->N][g->N],
           double R[g->N][g->N], double B[g->n][g->N][PADDED(g->N)], char on[g->n][g->N],
           double V[g->r][g->n], double dV[g->r][g->n][g->n], double rest[g->r][g->n], double *round);
void deviation(int N, int k, int rows, const double *h, double R[N][N], double B[k][N][PADDED(N)], char on[k][N],
               double D[N][N], double *share);
int enclose(int N, double eps, double D[N][N], double F[N][N], double Y[N][N]);
int enclose_columns(int N, int k, int w, int at, double eps, const double *h, double R[N][N], double D[N][N],
                    double B[k][N][PADDED(N)], char on[k][N], double Z[N][w], double F[N][N], double dZ[k][N][w],
                    double first[N][w], double rough[N][w], double Y[N][N]);
int margin_on(int n, int N, int r, int k, double eps, const double *h, double A[N][N], double R[N][N],
              double B[k][N][PADDED(N)], char on[k][N], double V[r][n], double dV[r][n][k], double rest[r][n], double Y[N][N],
              double *bound, double *center, int *split);

#endif
