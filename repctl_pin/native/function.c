/* F at one pose, and at several at once, one in each lane of the vector units. */

#include <math.h>

#include "function.h"

#ifdef LEVEL /* of the library, in which chart.c is another object */
#include "vector_levels.h"
#define find_configuration LEVELLED(find_configuration)
#define find_configurations LEVELLED(find_configurations)
#include "chart_polynomials.h" /* of one pose */
#endif

#define LANE(x, l) (((double *)&(x))[l])

#define Number double
#define LANES 1
#define UNFOLDED UNROLLED
#define LANED(name) name##_of_one
#include "chart_newton.h"
#undef Number
#undef LANES
#undef UNFOLDED
#undef LANED

#define Number Several
#define Weight double
#define Sum Several
#define PER 1
#define LANES AT_ONCE
#define UNFOLDED
#define LANED(name) name##_of_several
#include "chart_polynomials.h"
#include "chart_newton.h"
#undef Number
#undef Weight
#undef Sum
#undef PER
#undef LANES
#undef UNFOLDED
#undef LANED

SHARED int find_configuration(const Arm *arm, const Chart *chart, int keep, const Pose *target, const double *leaf,
                              double q[]) {
  double u[6] = {0.0}, T[CHART_TERMS], both[WIDE], shift[N], level[N], x[N], start[N], goal[12], state[1];
  int status;
  if (leaf && !all_finite(leaf, N - M)) return BAD_NUMBER;
  status = find_coordinates(arm, chart, target, u, shift);
  if (status != OK) return status;
  monomials_of_one(chart, u, T);
  references_of_one(arm, chart, T, both);
  for (int i = 0; i < 3; i++) goal[i] = target->p[i];
  for (int i = 0; i < 9; i++) goal[3 + i] = target->R[i];
  for (int j = 0; j < N - M; j++) level[j] = leaf ? leaf[j] : 0.0;
  for (int i = 0; i < N; i++) {
    both[i] += shift[i];
    start[i] = both[i];
    for (int j = 0; leaf && j < N - M; j++) start[i] += leaf[j] * both[Q_WIDE + j * N + i];
    x[i] = start[i];
  }
  settle_of_one(arm, chart, goal, both, level, x, state);
  if (state[0] > 0.0)
    for (int i = 0; i < N; i++) start[i] = x[i];
  else if (!(solve_chart(arm, target, both, both + Q_WIDE, leaf, 12, 0.3, 1e-7, start) <= 1e-7))
    return OUTSIDE;
  if (!joints_allowed(arm, keep, leaf, start)) return OUTSIDE;
  for (int i = 0; i < N; i++) q[i] = start[i];
  return OK;
}

/* q and its status at up to AT_ONCE targets. The leaf of the next target is stride numbers further. */
SHARED void find_configurations(const Arm *arm, const Chart *chart, int keep, int count, const Pose *targets,
                                const double *leaf, int stride, double *q, int status[]) {
  Several u[6], T[CHART_TERMS], both[WIDE], level[N], x[N], goal[12], shift[N];
  double state[AT_ONCE];
  for (int l = 0; l < AT_ONCE; l++) { /* after the last target, that one again */
    const int at = l < count ? l : count - 1;
    double one[6], added[N];
    const int found = find_coordinates(arm, chart, targets + at, one, added);
    if (l < count) status[l] = found;
    for (int k = 0; k < 6; k++) LANE(u[k], l) = found == OK && k < chart->k ? one[k] : 0.0;
    for (int i = 0; i < N; i++) LANE(shift[i], l) = found == OK ? added[i] : 0.0;
    for (int i = 0; i < 3; i++) LANE(goal[i], l) = targets[at].p[i];
    for (int i = 0; i < 9; i++) LANE(goal[3 + i], l) = targets[at].R[i];
    for (int j = 0; j < N - M; j++) LANE(level[j], l) = leaf ? leaf[at * stride + j] : 0.0;
  }
  monomials_of_several(chart, u, T);
  references_of_several(arm, chart, T, both);
  for (int i = 0; i < N; i++) {
    both[i] += shift[i];
    x[i] = both[i];
    for (int j = 0; j < N - M; j++) x[i] += level[j] * both[Q_WIDE + j * N + i];
  }
  settle_of_several(arm, chart, goal, both, level, x, state);
  for (int l = 0; l < count; l++) {
    const double *c = leaf ? leaf + l * stride : 0;
    double found[N];
    if (status[l] != OK) continue;
    for (int i = 0; i < N; i++) found[i] = LANE(x[i], l);
    if (!(state[l] > 0.0) || !joints_allowed(arm, keep, c, found))
      status[l] = find_configuration(arm, chart, keep, targets + l, c, found);
    for (int i = 0; i < N && status[l] == OK; i++) q[l * N + i] = found[i];
  }
}
