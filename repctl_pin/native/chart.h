/* Cell of placements, and the chart of the function q = F(x; c) over it: f(q) = x, n_ref(u)^T (q - q_ref(u)) = c.

   y (M) are the coordinates of a placement relative to the middle of the cell, m and rad. Those among them that the
   cell moves, divided by their half-widths, are u (k). In a box, y is the task error from the middle. In a sector, y
   are the radius, angle and height around an axis, two tilts and the spin of the tool; the orientation turns with the
   angle. There y[0] is the radius less the middle's and the bend at this height, divided by the stretch at this
   height. q_ref and n_ref are polynomials of u. F is linear in a coordinate that a symmetry of the arm removes from u:
   it is added, with a sign, to q_ref of one joint. */

#ifndef REPCTL_CHART_H
#define REPCTL_CHART_H

#include "arm.h"

#if defined(__FLT_EVAL_METHOD__) && __FLT_EVAL_METHOD__ != 0 /* numbers wider than double */
#define NEAREST(x) floor((x) + 0.5)
#else
#define NEAREST(x) (((x) + 6755399441055744.0) - 6755399441055744.0) /* 1.5 * 2^52 */
#endif

#ifdef EXPORTED
#define CHART_TERMS TERMS
#else
#define CHART_TERMS (chart->terms)
#endif

#ifdef __GNUC__
#define AT_ONCE 8 /* poses that a batch solves at once, in the lanes of vectors */
#define PAIR 2
typedef double Several __attribute__((vector_size(8 * AT_ONCE)));
typedef double Pair __attribute__((vector_size(8 * PAIR), aligned(8), may_alias));
#else
#define AT_ONCE 1
#define PAIR 1
typedef double Several, Pair;
#endif

#define EVEN(count) ((count) + (count) % 2)
#define Q_WIDE EVEN(N)                       /* q_ref */
#define WIDE (EVEN(N) + EVEN((N - M) * N))   /* q_ref, and n_ref^T by rows */

typedef struct Chart {
  int sector, k, removed, bent;            /* bent: degree of a sector's profile */
  int terms, both;                         /* monomials, a multiple of 4; n_ref has coefficients of the first ones */
  double radius, height, spin;             /* a sector's middle */
  const int *moved, *coordinate, *joint;   /* k: u among the y; removed: y, and the joint that it moves */
  const int *parent, *factor;              /* terms: monomial a is parent[a] times u[factor[a]]; the first is 1 */
  const int *row, *column;                 /* N: places of the rows and columns of J_V in an order of elimination */
  const double *p, *R;                     /* middle */
  const double *sign;                      /* removed */
  const double *origin, *basis, *turn;     /* a sector's axis; outward, around and along it, by rows; basis times R */
  const double *profile;                   /* bent + 1 each: bend and stretch of a sector's radius, by height */
  const double *center, *bounds, *scale;   /* M: |y - center| <= bounds in the cell; k: u = (y - center) scale */
  const double *lower, *upper;             /* M: bounds without tolerance, for the nearest placement in the cell */
  const double *weights;                   /* rows of WIDE for the first monomials, then of Q_WIDE */
} Chart;

SHARED void cell_coordinates(const Arm *arm, const Chart *chart, const Pose *x, double y[]);
SHARED int holds(const Arm *arm, const Chart *chart, const double y[]);
SHARED void scaled_coordinates(const Arm *arm, const Chart *chart, const double y[], double u[], double shift[]);
SHARED void cell_rates(const Arm *arm, const Chart *chart, const double R[9], const double y[], double d[]);
SHARED void cell_place(const Arm *arm, const Chart *chart, const double y[6], Pose *x);
SHARED void cell_twist(const Arm *arm, const Chart *chart, const double y[6], int b, double twist[6]);
SHARED void add_cell_potentials(const Arm *arm, const Chart *chart, const double q[], const double p[3],
                                const double R[9], double J[][N], double h[], double V[][N]);
SHARED int in_cell(const Arm *arm, const Chart *chart, const double p[3], const double R[9]);

#endif
