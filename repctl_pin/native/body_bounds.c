/* Lower bounds on the distances of pairs of convex bodies, from bounding spheres and boxes: body_bounds.py has the formulas. */

#include <math.h>

#include "linear_algebra.h"

typedef struct {
  int joints, bodies, pairs;
  const int *parent, *joint, *first, *second;      /* joints + 1; bodies; pairs, pairs */
  const double *fixed, *sine, *versine;            /* joints + 1 9: R_j = fixed + sin q sine + (1 - cos q) versine */
  const double *origin, *slide;                    /* joints + 1 3: p_j = origin + q slide, in the parent */
  const double *centers, *radii, *turns, *halves;  /* bodies 3, bodies, bodies 9, bodies 3: on their joints */
} BodyTables;

/* Placements of the joints; 0 is the root. */
static void place_joints(const BodyTables *own, const double *q, double R[][9], double p[][3]) {
  for (int i = 0; i < 9; i++) R[0][i] = i % 4 == 0;
  for (int i = 0; i < 3; i++) p[0][i] = 0;
  for (int j = 1; j <= own->joints; j++) {
    const int before = own->parent[j];
    const double s = sin(q[j - 1]), v = 1 - cos(q[j - 1]);
    double turned[9], step[3];
    for (int i = 0; i < 9; i++) turned[i] = own->fixed[9 * j + i] + s * own->sine[9 * j + i] + v * own->versine[9 * j + i];
    for (int i = 0; i < 3; i++) step[i] = own->origin[3 * j + i] + q[j - 1] * own->slide[3 * j + i];
    times(R[before], turned, 0, R[j]);
    for (int i = 0; i < 3; i++) p[j][i] = p[before][i];
    add_turned(R[before], step, p[j]);
  }
}

/* Extent of a body from its centre along u: of its sphere or of its box, the smaller one. */
static double extent(const BodyTables *own, const double axes[9], int body, const double u[3]) {
  double box = 0;
  for (int i = 0; i < 3; i++)
    box += own->halves[3 * body + i] * fabs(axes[i] * u[0] + axes[3 + i] * u[1] + axes[6 + i] * u[2]);
  return box < own->radii[body] ? box : own->radii[body];
}

/* Bounds (count, pairs) at every row of Q (count, joints). Boxes are used only where the bound of the spheres is below
   half the smallest distance between two centres, and centres are more than `telling` apart. */
EXPORT void body_bounds(const BodyTables *own, long count, double telling, const double *Q, double *bounds) {
  const int B = own->bodies, P = own->pairs;
  double R[own->joints + 1][9], p[own->joints + 1][3], centers[B + 1][3], axes[B + 1][9];
  for (long a = 0; a < count; a++, bounds += P) {
    double nearest = HUGE_VAL;
    place_joints(own, Q + a * own->joints, R, p);
    for (int b = 0; b < B; b++) {
      const int j = own->joint[b];
      for (int i = 0; i < 3; i++) centers[b][i] = p[j][i];
      add_turned(R[j], own->centers + 3 * b, centers[b]);
      times(R[j], own->turns + 9 * b, 0, axes[b]);
    }
    for (int k = 0; k < P; k++) {
      const double *c = centers[own->first[k]], *d = centers[own->second[k]];
      const double x = c[0] - d[0], y = c[1] - d[1], z = c[2] - d[2];
      bounds[k] = sqrt(x * x + y * y + z * z);
      if (bounds[k] < nearest) nearest = bounds[k];
    }
    for (int k = 0; k < P; k++) {
      const int one = own->first[k], other = own->second[k];
      const double gap = bounds[k];
      double u[3];
      bounds[k] = gap - own->radii[one] - own->radii[other];
      if (!(bounds[k] < nearest / 2 && gap > telling)) continue;
      for (int i = 0; i < 3; i++) u[i] = (centers[one][i] - centers[other][i]) / gap;
      bounds[k] = gap - extent(own, axes[one], one, u) - extent(own, axes[other], other, u);
    }
  }
}
