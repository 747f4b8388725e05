/* F at several poses at once, one in each lane of the vector units. */

#include <math.h>

#include "chart.h"

#ifdef LEVEL /* of the library */
#include "levels.h"
#define find_configurations LEVELLED(find_configurations)
#endif

#ifdef __GNUC__
typedef double Several __attribute__((vector_size(8 * AT_ONCE)));
#else
typedef double Several;
#endif

#define Number Several
#define LANES AT_ONCE
#define LANED(name) name##_of_several
#include "chart_lanes.h"
#undef Number

/* q and its status at up to AT_ONCE targets. The leaf of the next target is stride numbers further. */
SHARED void find_configurations(const Arm *arm, const Chart *chart, int count, const Pose *targets, const double *leaf,
                                int stride, double *q, int status[]) {
  Several u[6], T[CHART_TERMS], both[WIDE], level[N], x[N], goal[12], shift[N];
  double state[AT_ONCE];
  for (int l = 0; l < AT_ONCE; l++) { /* after the last target, that one again */
    const int at = l < count ? l : count - 1;
    double one[6], added[N];
    const int told = find_coordinates(arm, chart, targets + at, one, added);
    if (l < count) status[l] = told;
    for (int k = 0; k < chart->k; k++) ((double *)(u + k))[l] = told == OK ? one[k] : 0.0;
    for (int i = 0; i < N; i++) ((double *)(shift + i))[l] = told == OK ? added[i] : 0.0;
    for (int i = 0; i < 3; i++) ((double *)(goal + i))[l] = targets[at].p[i];
    for (int i = 0; i < 9; i++) ((double *)(goal + 3 + i))[l] = targets[at].R[i];
    for (int j = 0; j < N - M; j++) ((double *)(level + j))[l] = leaf ? leaf[at * stride + j] : 0.0;
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
    for (int i = 0; i < N; i++) found[i] = ((double *)(x + i))[l];
    if (!(state[l] > 0.0) || !joints_allowed(arm, chart, c, found))
      status[l] = find_configuration(arm, chart, targets + l, c, found);
    for (int i = 0; i < N && status[l] == OK; i++) q[l * N + i] = found[i];
  }
}
