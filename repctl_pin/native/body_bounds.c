/* Lower bounds on the distances of pairs of convex bodies, from bounding spheres and boxes: body_bounds.py has the formulas. */

#include <math.h>

#include "body_bounds.h"

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

void place_bodies(const BodyTables *own, const double *q, PlacedBody *placed) {
  double R[own->joints + 1][9], p[own->joints + 1][3];
  place_joints(own, q, R, p);
  for (int b = 0; b < own->bodies; b++) {
    const int j = own->joint[b];
    for (int i = 0; i < 3; i++) placed[b].center[i] = p[j][i];
    add_turned(R[j], own->centers + 3 * b, placed[b].center);
    times(R[j], own->turns + 9 * b, 0, placed[b].axes);
  }
}

double center_distance(const BodyTables *own, const PlacedBody *placed, int pair) {
  const double *c = placed[own->first[pair]].center, *d = placed[own->second[pair]].center;
  const double x = c[0] - d[0], y = c[1] - d[1], z = c[2] - d[2];
  return sqrt(x * x + y * y + z * z);
}

double sphere_bound(const BodyTables *own, int pair, double gap) {
  return gap - own->radii[own->first[pair]] - own->radii[own->second[pair]];
}

double box_bound(const BodyTables *own, const PlacedBody *placed, int pair, double gap) {
  const int one = own->first[pair], other = own->second[pair];
  double u[3];
  for (int i = 0; i < 3; i++) u[i] = (placed[one].center[i] - placed[other].center[i]) / gap;
  return gap - extent(own, placed[one].axes, one, u) - extent(own, placed[other].axes, other, u);
}

/* Bounds (count, pairs) at every row of Q (count, joints). Boxes are used only where the bound of the spheres is below
   half the smallest distance between two centres, and centres are more than `telling` apart. */
EXPORT void body_bounds(const BodyTables *own, long count, double telling, const double *Q, double *bounds) {
  const int P = own->pairs;
  PlacedBody placed[own->bodies + 1];
  for (long a = 0; a < count; a++, bounds += P) {
    double nearest = HUGE_VAL;
    place_bodies(own, Q + a * own->joints, placed);
    for (int k = 0; k < P; k++) {
      bounds[k] = center_distance(own, placed, k);
      if (bounds[k] < nearest) nearest = bounds[k];
    }
    for (int k = 0; k < P; k++) {
      const double gap = bounds[k];
      bounds[k] = sphere_bound(own, k, gap);
      if (bounds[k] < nearest / 2 && gap > telling) bounds[k] = box_bound(own, placed, k, gap);
    }
  }
}
