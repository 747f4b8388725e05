/* Whether all pairs of bodies keep their distance along a plan: body_guard.py has the formulas. */

#include <math.h>
#include <string.h>

#include "body_bounds.h"

#define FAR 0.5 /* distance beyond which a bound is not improved by boxes, m */

typedef struct {
  int pairs, joints, anchors, room, most;     /* room: samples of a plan, at most; most: pairs that are open, at most */
  int at_once, move, nodes;                          /* anchors that a plan replaces; work of another sample, in measured pairs */
  int next, left, nearest, excess;            /* anchor to replace; work left; a pair too near, or -1; too many are open */
  double stop, noise, telling;                /* m; telling: smallest distance of centres that has a direction */
  const BodyTables *tables;
  const double *reach, *turned, *kept, *rest; /* pairs joints: m per rad, and transposed; pairs: between samples, and at them */
  double *anchor, *bound;                     /* anchors joints, anchors pairs: configurations, and distances there */
  double *far, *lower, *way;                  /* pairs; most room: bounds at samples, and changes between them */
  double *found, *rows;                       /* pairs: as measured; a new anchor's bounds */
  int *best, *open, *which;                   /* pairs: the anchor that tells most; pairs to look at, and to measure */
  int *exact, *failed, *settled;              /* most room, most room, most: flags */
  int (*measure)(int sample, int count);      /* the distances of the pairs in which: 1, or 0 if that failed */
} BodyGuard;

static double product(int n, const double *x, const double *y) {
  double sum = 0;
  for (int j = 0; j < n; j++) sum += x[j] * y[j];
  return sum;
}

/* Lower bound on the distance of a pair after ways of the joints from an anchor. */
static double bound_from(const BodyGuard *own, int anchor, int pair, const double *moved) {
  return own->bound[(long)anchor * own->pairs + pair] - product(own->joints, moved, own->reach + (long)pair * own->joints);
}

/* The smallest distance that suffices at a sample; the last one is at rest. */
static double least_at(const BodyGuard *own, int pair, int last) { return own->rest[pair] - (last ? 0 : own->noise); }

/* A plan that is looked at, with what is known about its samples. */
typedef struct {
  int count, nodes;    /* samples; bounds at a sample that were computed */
  const double *Q, *S; /* count joints: the samples, and the ways of the joints up to them */
  const int *order;    /* the anchors, the nearest first */
  double *moved;       /* count anchors joints: ways from the anchors, of samples that are placed */
  PlacedJoint *placed; /* count joints + 1 */
  int *known;          /* count: whether the sample is placed */
} Samples;

/* Order the anchors by their way to a configuration, the nearest first. */
static void order_anchors(const BodyGuard *own, const double *q, int *order) {
  double far[own->anchors];
  for (int a = 0; a < own->anchors; a++) {
    int k = a;
    double sum = 0;
    for (int j = 0; j < own->joints; j++) sum += fabs(q[j] - own->anchor[a * own->joints + j]);
    for (; k > 0 && far[k - 1] > sum; k--) order[k] = order[k - 1], far[k] = far[k - 1];
    order[k] = a;
    far[k] = sum;
  }
}

/* Find the pairs of which the nearest anchor does not show that they keep their distance, in `open`; return their
   number. All pairs are looked at together, joint by joint, which is fast. */
static int find_undecided(BodyGuard *own, const Samples *plan) {
  const int n = own->joints, P = own->pairs, anchor = plan->order[0];
  int undecided = 0;
  memcpy(own->far, own->bound + (long)anchor * P, P * sizeof(double));
  for (int j = 0; j < n; j++) {
    const double *column = own->turned + (long)j * P, x = own->anchor[anchor * n + j];
    double most = 0, longest = 0, way;
    for (int k = 0; k < plan->count; k++) {
      const double *S = plan->S + k * n + j, moved = fabs(plan->Q[k * n + j] - x);
      if (!(moved <= most)) most = moved;
      if (k && !(S[0] - S[-n] <= longest)) longest = S[0] - S[-n];
    }
    way = most + longest / 2;
    for (int p = 0; p < P; p++) own->far[p] -= way * column[p];
  }
  for (int p = 0; p < P; p++) {
    own->best[p] = anchor;
    if (!(own->far[p] >= own->kept[p] + own->stop)) own->open[undecided++] = p;
  }
  return undecided;
}

/* Place the joints at a sample of a plan. */
static void place_sample(const BodyGuard *own, Samples *plan, int k) {
  const int n = own->joints, A = own->anchors;
  plan->known[k] = 1;
  place_joints(own->tables, plan->Q + k * n, plan->placed + k * (n + 1));
  for (int a = 0; a < A; a++)
    for (int j = 0; j < n; j++) plan->moved[(k * A + a) * n + j] = fabs(plan->Q[k * n + j] - own->anchor[a * n + j]);
}

/* Bound the distance of a pair at a placed sample by spheres, and by boxes if this does not suffice. */
static double shape_bound(const BodyGuard *own, const Samples *plan, int pair, int k, double need) {
  const BodyTables *tables = own->tables;
  const PlacedJoint *placed = plan->placed + k * (own->joints + 1);
  double c[3], d[3], gap, bound;
  place_center(tables, placed, tables->first[pair], c);
  place_center(tables, placed, tables->second[pair], d);
  gap = distance_of(c, d);
  bound = sphere_bound(tables, pair, gap);
  return bound >= need || !(gap > own->telling) ? bound : box_bound(tables, placed, pair, c, d, gap);
}

/* Lower bound on the distance of a pair at a placed sample by an anchor. */
static double anchor_bound(const BodyGuard *own, const Samples *plan, int pair, int k, int anchor) {
  return bound_from(own, anchor, pair, plan->moved + (k * own->anchors + anchor) * own->joints);
}

/* Bound the distance of a pair at a sample by spheres, boxes and anchors, until it suffices. */
static double bound_at(const BodyGuard *own, Samples *plan, int pair, int k, double need) {
  double lower;
  if (!plan->known[k]) place_sample(own, plan, k);
  plan->nodes++;
  lower = shape_bound(own, plan, pair, k, need);
  for (int i = -1; i < own->anchors && !(lower >= need); i++) {
    const int a = i < 0 ? own->best[pair] : plan->order[i];
    const double bound = anchor_bound(own, plan, pair, k, a);
    if (!(bound <= lower)) lower = bound, own->best[pair] = a;
  }
  return lower;
}

/* Bound how much the distance of a pair changes on the plan from one sample to another. */
static double change_between(const BodyGuard *own, const Samples *plan, int pair, int from, int to) {
  const int n = own->joints;
  const double *reach = own->reach + (long)pair * n;
  double sum = 0;
  for (int j = 0; j < n; j++) sum += (plan->S[to * n + j] - plan->S[from * n + j]) * reach[j];
  return sum;
}

/* Tell whether bounds show that a pair keeps its distance from one sample to another: by the bound in the middle, or in
   both halves. */
static int keeps_between(const BodyGuard *own, Samples *plan, int pair, int from, int to) {
  const int middle = (from + to) / 2;
  const double least = own->rest[pair] > own->kept[pair] ? own->rest[pair] : own->kept[pair];
  const double before = change_between(own, plan, pair, from, middle), after = change_between(own, plan, pair, middle, to);
  const double need = least + (before > after ? before : after);
  if (bound_at(own, plan, pair, middle, need) >= need) return 1;
  if (to - from < 2) return 0;
  return keeps_between(own, plan, pair, from, middle) && keeps_between(own, plan, pair, middle, to);
}

/* Find the pairs whose bounds do not suffice at some samples, in `open`, with `lower` and `way`; return their number, or
   -1 minus it if there are too many, or too many bounds were needed. */
static int find_open(BodyGuard *own, Samples *plan, int undecided) {
  int open = 0;
  for (int i = 0; i < undecided; i++) {
    const int pair = own->open[i];
    double *way, *lower;
    if (plan->nodes > own->nodes) return -1 - open;
    if (keeps_between(own, plan, pair, 0, plan->count - 1)) continue;
    if (open == own->most) return -1 - open;
    way = own->way + (long)open * own->room;
    lower = own->lower + (long)open * own->room;
    for (int k = 0; k < plan->count; k++) {
      lower[k] = bound_at(own, plan, pair, k, HUGE_VAL);
      if (k) way[k - 1] = change_between(own, plan, pair, k - 1, k);
    }
    memset(own->exact + (long)open * own->room, 0, sizeof(int) * own->room);
    own->settled[open] = 0;
    own->open[open++] = pair;
  }
  return open;
}

/* Mark the samples at which the bounds of an open pair do not suffice; return 1 if measuring cannot mend it. */
static int mark_failed(BodyGuard *own, int o, int count) {
  const int pair = own->open[o];
  const double *lower = own->lower + (long)o * own->room, *way = own->way + (long)o * own->room;
  const int *exact = own->exact + (long)o * own->room;
  int *failed = own->failed + (long)o * own->room;
  int hopeless = 0, any = 0;
  for (int k = 0; k < count; k++) {
    failed[k] = !(lower[k] >= least_at(own, pair, k == count - 1));
    hopeless |= failed[k] & exact[k];
  }
  for (int k = 0; k < count - 1; k++)
    if (!(lower[k] + lower[k + 1] - way[k] >= 2 * own->kept[pair])) {
      failed[k] = failed[k + 1] = 1;
      hopeless |= exact[k] & exact[k + 1];
    }
  for (int k = 0; k < count; k++) any |= failed[k];
  own->settled[o] = !any;
  return hopeless;
}

/* Choose the sample at which distances are measured next: the last one, or that of the smallest bound; -1 if no more are
   needed. A pair that is too near, or that has the smallest bound, becomes `nearest`; it stays -1 if all are settled. */
static int next_sample(BodyGuard *own, int open, int count) {
  double least = HUGE_VAL, smallest = HUGE_VAL;
  int at = -1, refused = 0;
  own->nearest = -1;
  for (int o = 0; o < open; o++) {
    const double *lower = own->lower + (long)o * own->room, kept = own->kept[own->open[o]];
    int hopeless;
    if (own->settled[o]) continue;
    hopeless = mark_failed(own, o, count);
    for (int k = 0; k < count; k++) {
      if (!own->failed[(long)o * own->room + k]) continue;
      if (own->nearest < 0 || hopeless > refused || (hopeless == refused && lower[k] - kept < smallest)) {
        own->nearest = own->open[o];
        smallest = lower[k] - kept;
        refused |= hopeless;
      }
      if (own->exact[(long)o * own->room + k] || at == count - 1) continue;
      if (at < 0 || k == count - 1 || lower[k] - kept < least) at = k, least = lower[k] - kept;
    }
  }
  return refused ? -1 : at;
}

/* Measure the open pairs that fail at a sample, those of the smallest bounds first, as far as the work that is left
   suffices. Return their number; -1 if measuring failed. */
static int measure_at(BodyGuard *own, int open, int at, int count, const double *Q) {
  const int n = own->joints, most = own->left - own->move;
  int list[open], many = 0;
  for (int o = 0; o < open; o++) {
    const double spare = own->lower[(long)o * own->room + at] - own->kept[own->open[o]];
    int i = many;
    if (own->settled[o] || !own->failed[(long)o * own->room + at] || own->exact[(long)o * own->room + at]) continue;
    if (many >= most) {
      if (most <= 0 || !(spare < own->lower[(long)list[many - 1] * own->room + at] - own->kept[own->open[list[many - 1]]]))
        continue;
      i = --many;
    }
    for (; i > 0 && own->lower[(long)list[i - 1] * own->room + at] - own->kept[own->open[list[i - 1]]] > spare; i--)
      list[i] = list[i - 1];
    list[i] = o;
    many++;
  }
  for (int i = 0; i < many; i++) own->which[i] = own->open[list[i]];
  own->left -= own->move + many;
  if (many && !own->measure(at, many)) return -1;
  for (int i = 0; i < many; i++) {
    const double *reach = own->reach + (long)own->which[i] * n;
    double *lower = own->lower + (long)list[i] * own->room;
    own->exact[(long)list[i] * own->room + at] = 1;
    for (int k = 0; k < count; k++) {
      double change = 0;
      for (int j = 0; j < n; j++) change += fabs(Q[k * n + j] - Q[at * n + j]) * reach[j];
      if (!(own->found[i] - change <= lower[k])) lower[k] = own->found[i] - change;
    }
  }
  return many;
}

/* Remember the bounds at a sample, in place of the oldest anchor. Those of pairs that are not open are by boxes, or follow
   from the anchor that tells most about them. */
static void remember(BodyGuard *own, Samples *plan, int open, int k) {
  const int n = own->joints, P = own->pairs;
  if (!plan->known[k]) place_sample(own, plan, k);
  for (int p = 0; p < P; p++) {
    const double bound = anchor_bound(own, plan, p, k, own->best[p]);
    const double shape = bound >= FAR ? bound : shape_bound(own, plan, p, k, FAR);
    own->rows[p] = bound >= shape ? bound : shape;
  }
  for (int o = 0; o < open; o++) {
    const double bound = own->lower[(long)o * own->room + k];
    if (bound > own->rows[own->open[o]]) own->rows[own->open[o]] = bound;
  }
  memcpy(own->anchor + own->next * n, plan->Q + k * n, n * sizeof(double));
  memcpy(own->bound + (long)own->next * P, own->rows, P * sizeof(double));
  own->next = (own->next + 1) % own->anchors;
}

/* Tell whether a plan is allowed: 1 or 0, or -1 if measuring failed. Q (count, joints) are its samples, and S the ways of
   the joints up to them. */
EXPORT int body_guard_allows(BodyGuard *own, int count, const double *Q, const double *S) {
  const int n = own->joints;
  int order[own->anchors], known[count], sample[count], samples = 0, undecided, open, at;
  double moved[(long)count * own->anchors * n];
  PlacedJoint placed[count * (n + 1)];
  Samples plan = {count, 0, Q, S, order, moved, placed, known};
  memset(known, 0, sizeof(known));
  order_anchors(own, Q + (count / 2) * n, order);
  own->nearest = -1;
  own->excess = 0;
  undecided = find_undecided(own, &plan);
  if (!undecided) return 1;
  open = find_open(own, &plan, undecided);
  own->excess = open < 0;
  if (own->excess) open = -1 - open;
  while ((at = next_sample(own, open, count)) >= 0 && own->left > own->move && samples < count) {
    if (measure_at(own, open, at, count, Q) < 0) return -1;
    sample[samples++] = at;
  }
  if (own->excess && own->nearest < 0) own->nearest = own->open[0];
  at = samples < own->at_once ? samples : own->at_once;
  if (!samples && (own->excess || undecided > own->pairs / 8)) remember(own, &plan, open, count / 2);
  for (int i = 0; i < at; i++) remember(own, &plan, open, sample[samples - 1 - i * samples / at]);
  return own->nearest < 0;
}
