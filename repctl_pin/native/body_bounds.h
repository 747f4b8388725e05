/* Lower bounds on the distances of pairs of convex bodies, from bounding spheres and boxes: body_bounds.py. */

#ifndef REPCTL_BODY_BOUNDS_H
#define REPCTL_BODY_BOUNDS_H

#include "linear_algebra.h"

typedef struct {
  int joints, bodies, pairs;
  const int *parent, *joint, *first, *second;      /* joints + 1; bodies; pairs, pairs */
  const double *fixed, *sine, *versine;            /* joints + 1 9: R_j = fixed + sin q sine + (1 - cos q) versine */
  const double *origin, *slide;                    /* joints + 1 3: p_j = origin + q slide, in the parent */
  const double *centers, *radii, *turns, *halves;  /* bodies 3, bodies, bodies 9, bodies 3: on their joints */
} BodyTables;

/* A body that is placed: its centre, and the axes of its box. */
typedef struct {
  double center[3], axes[9];
} PlacedBody;

/* Place all bodies at joints q. */
void place_bodies(const BodyTables *own, const double *q, PlacedBody *placed);

/* Distance of the centres of a pair; bounds from its spheres and from its boxes, given this distance, above 0. */
double center_distance(const BodyTables *own, const PlacedBody *placed, int pair);
double sphere_bound(const BodyTables *own, int pair, double gap);
double box_bound(const BodyTables *own, const PlacedBody *placed, int pair, double gap);

#endif
