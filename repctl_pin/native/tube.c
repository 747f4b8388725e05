/* Tubes: the sample of a motion that is nearest to a configuration. */

#include <math.h>

#include "arm.h"

/* For each of count rows of Q, find the nearest of the samples S, at least one, in the maximum norm over n columns:
   its index and its distance. */
EXPORT void nearest_samples(int n, long count, long samples, const double *Q, const double *S, long *which,
                            double *distance) {
  for (long k = 0; k < count; k++, Q += n) {
    which[k] = 0;
    distance[k] = HUGE_VAL;
    for (long s = 0; s < samples; s++) {
      double farthest = 0.0;
      for (int i = 0; i < n && farthest < distance[k]; i++) {
        const double apart = fabs(Q[i] - S[s * n + i]);
        if (apart > farthest) farthest = apart;
      }
      if (farthest < distance[k]) {
        which[k] = s;
        distance[k] = farthest;
      }
    }
  }
}
