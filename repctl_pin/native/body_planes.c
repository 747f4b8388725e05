/* Tight lower bounds on the distances of the few pairs of convex bodies that can be the nearest one.

   A body is the sum of a convex hull of corners, a ball and a disc, so that its farthest point along u is known. With a and b
   the farthest points of two bodies along -u and u, a unit vector, their distance is at least u . (a - b). The best u is along
   the shortest vector from a point of the second body to one of the first, which the algorithm of Gilbert, Johnson and Keerthi
   approaches; its length bounds the distance from above. */

#include "body_bounds.h"

enum { PLANES = 16, CANDIDATES = 64 }; /* per pair, and pairs that are tightened, at most */

#define CLOSE 1e-4 /* difference of a bound from the distance of two points that is not reduced, m */

/* Find the corner of a body that is farthest along u, in the frame of its joint. */
static void farthest_corner(const BodyTables *own, int body, const double u[3], double corner[3]) {
  const double *block = own->corners + 3 * LANES * own->block[body], *at = block;
  const double *end = own->corners + 3 * LANES * own->block[body + 1];
  double best = -HUGE_VAL, along[LANES];
  for (; block < end; block += 3 * LANES) {
    double half[LANES / 2], most;
    for (int i = 0; i < LANES; i++) along[i] = u[0] * block[i] + u[1] * block[LANES + i] + u[2] * block[2 * LANES + i];
    for (int i = 0; i < LANES / 2; i++) half[i] = along[i] > along[LANES / 2 + i] ? along[i] : along[LANES / 2 + i];
    most = half[0];
    for (int i = 1; i < LANES / 2; i++) most = half[i] > most ? half[i] : most;
    if (most > best) best = most, at = block;
  }
  for (int i = LANES - 1; i >= 0; i--)
    if (i == LANES - 1 || u[0] * at[i] + u[1] * at[LANES + i] + u[2] * at[2 * LANES + i] == best)
      for (int k = 0; k < 3; k++) corner[k] = at[k * LANES + i];
}

/* Find the point of a body that is farthest along the unit vector u: at a corner, plus a ball, plus a disc. */
static void farthest_point(const BodyTables *own, const PlacedJoint *placed, int body, const double u[3], double x[3]) {
  const PlacedJoint *joint = placed + own->joint[body];
  const double *axis = own->axis + 3 * body;
  double local[3], point[3];
  turn_back(joint->R, u, local);
  farthest_corner(own, body, local, point);
  for (int i = 0; i < 3; i++) point[i] += own->ball[body] * local[i];
  if (own->disc[body] > 0) {
    const double along = dot(local, axis);
    double across[3], length;
    for (int i = 0; i < 3; i++) across[i] = local[i] - along * axis[i];
    length = sqrt(dot(across, across));
    for (int i = 0; i < 3 && length > 0; i++) point[i] += own->disc[body] * across[i] / length;
  }
  for (int i = 0; i < 3; i++) x[i] = joint->p[i];
  add_turned(joint->R, point, x);
}

/* A pair whose bound is tightened by planes between its bodies. */
typedef struct {
  int pair, planes, count;
  double w[4][3], share[4]; /* count differences of a point of the first body and one of the second; their shares of v */
  double v[3], length;      /* a difference, and its length; that of the centres before the first plane */
} Candidate;

static Candidate candidate(const BodyTables *own, double (*centers)[3], int pair) {
  Candidate made = {.pair = pair};
  const double *c = centers[own->first[pair]], *d = centers[own->second[pair]];
  for (int i = 0; i < 3; i++) made.v[i] = c[i] - d[i];
  made.length = distance_of(c, d);
  return made;
}

/* Find shares, of sum 1, with which the differences of a pair add up to the shortest vector; return 0 if rounding prevents
   this. Shares can be negative. */
static int affine_shares(const Candidate *pair, double *share) {
  const int n = pair->count;
  double A[4][4], sum = 0;
  for (int i = 0; i < n; i++) {
    share[i] = 1;
    for (int j = 0; j < n; j++) A[i][j] = 1 + dot(pair->w[i], pair->w[j]);
  }
  for (int i = 0; i < n; i++) {
    if (!(A[i][i] > 1e-14)) return 0;
    for (int k = i + 1; k < n; k++) {
      const double ratio = A[k][i] / A[i][i];
      for (int j = i; j < n; j++) A[k][j] -= ratio * A[i][j];
      share[k] -= ratio * share[i];
    }
  }
  for (int i = n - 1; i >= 0; i--) {
    for (int j = i + 1; j < n; j++) share[i] -= A[i][j] * share[j];
    share[i] /= A[i][i];
    sum += share[i];
  }
  for (int i = 0; i < n; i++) share[i] /= sum;
  return 1;
}

/* Set v to the shortest vector of the convex hull of the differences, by Wolfe's algorithm, and leave out those that it does
   not need. Return 0 if rounding prevents this. */
static int shorten(Candidate *pair) {
  for (;;) {
    double best[4], step = 1;
    int kept = 0;
    if (!affine_shares(pair, best)) return 0;
    for (int i = 0; i < pair->count; i++) {
      const double falls = pair->share[i] - best[i];
      if (best[i] <= 0 && falls > 0 && pair->share[i] < step * falls) step = pair->share[i] / falls;
    }
    for (int i = 0; i < pair->count; i++) {
      const double share = pair->share[i] + step * (best[i] - pair->share[i]);
      if (!(share > 1e-12)) continue;
      pair->share[kept] = share;
      for (int k = 0; k < 3; k++) pair->w[kept][k] = pair->w[i][k];
      kept++;
    }
    if (kept == pair->count || !kept) break;
    pair->count = kept;
  }
  for (int k = 0; k < 3; k++) {
    pair->v[k] = 0;
    for (int i = 0; i < pair->count; i++) pair->v[k] += pair->share[i] * pair->w[i][k];
  }
  pair->length = sqrt(dot(pair->v, pair->v));
  return 1;
}

/* Tell whether another plane can tighten the bound of a pair. */
static int is_open(const Candidate *pair, double telling, double bound) {
  return pair->planes < PLANES && pair->length > telling && pair->length - bound > CLOSE;
}

/* Tighten the bound of a pair by the plane normal to v, then shorten v: a step of the algorithm of Gilbert, Johnson and
   Keerthi, which coal uses, too. */
static void add_plane(const BodyTables *own, const PlacedJoint *placed, Candidate *pair, double *bound) {
  double u[3], x[3], y[3], *w = pair->w[pair->count], lower;
  for (int i = 0; i < 3; i++) u[i] = -pair->v[i] / pair->length;
  farthest_point(own, placed, own->first[pair->pair], u, x);
  for (int i = 0; i < 3; i++) u[i] = -u[i];
  farthest_point(own, placed, own->second[pair->pair], u, y);
  for (int i = 0; i < 3; i++) w[i] = x[i] - y[i];
  lower = dot(u, w);
  if (lower > *bound) *bound = lower;
  pair->share[pair->count] = !pair->count;
  pair->count++;
  pair->planes = shorten(pair) && pair->count < 4 ? pair->planes + 1 : PLANES;
}

/* Tighten the bounds of pairs for collisions only until they exclude a collision; they then become infinite. */
static void exclude_collisions(const BodyTables *own, double telling, const PlacedJoint *placed, double (*centers)[3],
                               double *bounds) {
  for (int k = 0; k < own->pairs; k++) {
    if (!own->only_contact[k]) continue;
    if (bounds[k] < 0) {
      Candidate pair = candidate(own, centers, k);
      while (bounds[k] < 0 && is_open(&pair, telling, bounds[k])) add_plane(own, placed, &pair, bounds + k);
    }
    if (bounds[k] >= 0) bounds[k] = HUGE_VAL;
  }
}

/* Tighten the bounds of the measured pairs that can be the nearest one, that of the smallest bound first. */
static void tighten_nearest(const BodyTables *own, double telling, const PlacedJoint *placed, double (*centers)[3],
                            double *bounds) {
  Candidate pairs[CANDIDATES];
  double upper = HUGE_VAL;
  int first = -1, count = 0;
  for (int k = 0; k < own->pairs; k++)
    if (!own->only_contact[k] && (first < 0 || bounds[k] < bounds[first])) first = k;
  if (first < 0) return;
  pairs[count++] = candidate(own, centers, first);
  while (pairs->planes < 2 && is_open(pairs, telling, bounds[first])) {
    add_plane(own, placed, pairs, bounds + first);
    upper = pairs->length;
  }
  for (int k = 0; k < own->pairs && count < CANDIDATES; k++)
    if (!own->only_contact[k] && bounds[k] < upper && k != first) pairs[count++] = candidate(own, centers, k);
  for (;;) {
    int lowest = -1, open = 0;
    for (int i = 0; i < count; i++) {
      const double bound = bounds[pairs[i].pair];
      if (!(bound < upper) || !is_open(pairs + i, telling, bound)) continue;
      if (lowest < 0 || bound < bounds[pairs[lowest].pair]) lowest = i;
      open++;
    }
    if (!open || (open == 1 && pairs[lowest].length == upper)) return; /* the nearest one is known */
    add_plane(own, placed, pairs + lowest, bounds + pairs[lowest].pair);
    if (pairs[lowest].length < upper) upper = pairs[lowest].length;
  }
}

/* Tighten bounds (count, pairs) of all pairs at every row of Q (count, joints), as far as they decide which is nearest. */
EXPORT void tighten_bounds(const BodyTables *own, long count, double telling, const double *Q, double *bounds) {
  PlacedJoint placed[own->joints + 1];
  double centers[own->bodies + 1][3];
  for (long a = 0; a < count; a++, bounds += own->pairs) {
    place_joints(own, Q + a * own->joints, placed);
    for (int b = 0; b < own->bodies; b++) place_center(own, placed, b, centers[b]);
    exclude_collisions(own, telling, placed, centers, bounds);
    tighten_nearest(own, telling, placed, centers, bounds);
  }
}
