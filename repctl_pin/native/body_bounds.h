/* Lower bounds on the distances of pairs of convex bodies, from bounding spheres and boxes: body_bounds.py. */

#ifndef REPCTL_BODY_BOUNDS_H
#define REPCTL_BODY_BOUNDS_H

#include <math.h>

#include "linear_algebra.h"

enum { LANES = 8 }; /* corners per block, which are computed together */

typedef struct {
  int joints, bodies, pairs;
  const int *parent, *joint, *first, *second;      /* joints + 1; bodies; pairs, pairs */
  const double *fixed, *sine, *versine;            /* joints + 1 9: R_j = fixed + sin q sine + (1 - cos q) versine */
  const double *origin, *slide;                    /* joints + 1 3: p_j = origin + q slide, in the parent */
  const double *centers, *radii, *turns, *halves;  /* bodies 3, bodies, bodies 9, bodies 3: on their joints */
  const int *block, *only_contact;                 /* bodies + 1: the first block of corners; pairs: flags */
  const double *corners, *ball, *disc, *axis;      /* blocks 3 LANES, bodies, bodies, bodies 3: on their joints */
} BodyTables;

/* Placement of a joint. */
typedef struct {
  double R[9], p[3];
} PlacedJoint;

/* Place the joints at q; 0 is the root. Find the centre of a body with them. */
void place_joints(const BodyTables *own, const double *q, PlacedJoint *placed);
void place_center(const BodyTables *own, const PlacedJoint *placed, int body, double center[3]);

/* Bounds on the distance of a pair from its spheres and from its boxes; `gap` > 0 is the distance of the centres c, d. */
double sphere_bound(const BodyTables *own, int pair, double gap);
double box_bound(const BodyTables *own, const PlacedJoint *placed, int pair, const double c[3], const double d[3], double gap);

static inline double distance_of(const double c[3], const double d[3]) {
  const double x = c[0] - d[0], y = c[1] - d[1], z = c[2] - d[2];
  return sqrt(x * x + y * y + z * z);
}

#endif
