/* Lower bounds on the distances of pairs of convex bodies: body_bounds.py has the formulas. */

#include "body_bounds.h"

void place_joints(const BodyTables *own, const double *q, PlacedJoint *placed) {
  for (int i = 0; i < 9; i++) placed[0].R[i] = i % 4 == 0;
  for (int i = 0; i < 3; i++) placed[0].p[i] = 0;
  for (int j = 1; j <= own->joints; j++) {
    const PlacedJoint *before = placed + own->parent[j];
    const double s = sin(q[j - 1]), v = 1 - cos(q[j - 1]);
    double turned[9], step[3];
    for (int i = 0; i < 9; i++) turned[i] = own->fixed[9 * j + i] + s * own->sine[9 * j + i] + v * own->versine[9 * j + i];
    for (int i = 0; i < 3; i++) step[i] = own->origin[3 * j + i] + q[j - 1] * own->slide[3 * j + i];
    times(before->R, turned, 0, placed[j].R);
    for (int i = 0; i < 3; i++) placed[j].p[i] = before->p[i];
    add_turned(before->R, step, placed[j].p);
  }
}

void place_center(const BodyTables *own, const PlacedJoint *placed, int body, double center[3]) {
  const PlacedJoint *joint = placed + own->joint[body];
  for (int i = 0; i < 3; i++) center[i] = joint->p[i];
  add_turned(joint->R, own->centers + 3 * body, center);
}

/* Extent of a body from its centre along u: of its sphere or of its box, the smaller one. */
static double extent(const BodyTables *own, const PlacedJoint *placed, int body, const double u[3]) {
  double on_joint[3], on_body[3], box = 0;
  turn_back(placed[own->joint[body]].R, u, on_joint);
  turn_back(own->turns + 9 * body, on_joint, on_body);
  for (int i = 0; i < 3; i++) box += own->halves[3 * body + i] * fabs(on_body[i]);
  return box < own->radii[body] ? box : own->radii[body];
}

double sphere_bound(const BodyTables *own, int pair, double gap) {
  return gap - own->radii[own->first[pair]] - own->radii[own->second[pair]];
}

double box_bound(const BodyTables *own, const PlacedJoint *placed, int pair, const double c[3], const double d[3],
                 double gap) {
  double u[3];
  for (int i = 0; i < 3; i++) u[i] = (c[i] - d[i]) / gap;
  return gap - extent(own, placed, own->first[pair], u) - extent(own, placed, own->second[pair], u);
}

/* Bounds (count, pairs) at every row of Q (count, joints). Boxes are used only where the bound of the spheres is below
   half the smallest distance between two centres, and centres are more than `telling` apart. */
EXPORT void body_bounds(const BodyTables *own, long count, double telling, const double *Q, double *bounds) {
  const int P = own->pairs;
  PlacedJoint placed[own->joints + 1];
  double centers[own->bodies + 1][3];
  for (long a = 0; a < count; a++, bounds += P) {
    double nearest = HUGE_VAL;
    place_joints(own, Q + a * own->joints, placed);
    for (int b = 0; b < own->bodies; b++) place_center(own, placed, b, centers[b]);
    for (int k = 0; k < P; k++) {
      bounds[k] = distance_of(centers[own->first[k]], centers[own->second[k]]);
      if (bounds[k] < nearest) nearest = bounds[k];
    }
    for (int k = 0; k < P; k++) {
      const double gap = bounds[k];
      bounds[k] = sphere_bound(own, k, gap);
      if (bounds[k] < nearest / 2 && gap > telling)
        bounds[k] = box_bound(own, placed, k, centers[own->first[k]], centers[own->second[k]], gap);
    }
  }
}
