/* F at several poses at once, one in each lane of the vector units. */

#include <math.h>

#include "chart.h"

#define LANES 8 /* LANES_AT_ONCE */
#include "chart_lanes.h"
#undef LANES

/* q and its status at up to LANES_AT_ONCE targets. The leaf of the next target is stride numbers further. */
SHARED void find_configurations(const Arm *arm, const Chart *chart, int count, const Pose *targets, const double *leaf,
                                int stride, double *q, int status[]) {
  enum { L = LANES_AT_ONCE };
  double u[6][L], T[chart->terms][L], both[WIDE][L], level[N][L], x[N][L], goal[12][L], state[L], shift[N][L];
  for (int l = 0; l < L; l++) { /* after the last target, that one again */
    const int at = l < count ? l : count - 1;
    double one[6], added[N];
    const int told = find_coordinates(arm, chart, targets + at, one, added);
    if (l < count) status[l] = told;
    for (int k = 0; k < chart->k; k++) u[k][l] = told == OK ? one[k] : 0.0;
    for (int i = 0; i < N; i++) shift[i][l] = told == OK ? added[i] : 0.0;
    for (int i = 0; i < 3; i++) goal[i][l] = targets[at].p[i];
    for (int i = 0; i < 9; i++) goal[3 + i][l] = targets[at].R[i];
    for (int j = 0; j < N - M; j++) level[j][l] = leaf ? leaf[at * stride + j] : 0.0;
  }
  monomials_8(chart, u, T);
  references_8(arm, chart, T, both);
  for (int i = 0; i < N; i++)
    for (int l = 0; l < L; l++) x[i][l] = both[i][l] += shift[i][l];
  for (int j = 0; leaf && j < N - M; j++)
    for (int i = 0; i < N; i++)
      for (int l = 0; l < L; l++) x[i][l] += level[j][l] * both[Q_WIDE + j * N + i][l];
  settle_8(arm, chart, goal, both, level, x, state);
  for (int l = 0; l < count; l++) {
    const double *c = leaf ? leaf + l * stride : 0;
    double found[N];
    if (status[l] != OK) continue;
    for (int i = 0; i < N; i++) found[i] = x[i][l];
    if (!(state[l] > 0.0) || !joints_allowed(arm, chart, c, found))
      status[l] = find_configuration(arm, chart, targets + l, c, found);
    for (int i = 0; i < N && status[l] == OK; i++) q[l * N + i] = found[i];
  }
}
