/* The control law as Python calls it: arguments in one block of memory per thread, and batches. */

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "law.h"
#include "least_speed.h"

typedef struct {
  const Arm *arm;
  double *q, *xdot, *twist, *leaf, *limit; /* N, M, 6 FRAMES, N - M, N */
  const double *posture;                   /* N; NULL: none */
  double *target;                          /* 16 FRAMES: [R p; 0 1] by rows */
  double *numbers;                         /* 5: dt, gain, damping; then the report: damping, slowed */
  double *result;                          /* N */
  double *inverse;                         /* N M */
} Call;

EXPORT int call_velocity(const Call *call) { return find_velocity(call->arm, call->q, call->xdot, call->result); }

EXPORT int call_inverse(const Call *call) { return find_inverse(call->arm, call->q, call->inverse); }

EXPORT int call_least_inverse(const Call *call) { return least_inverse(call->arm, call->q, call->inverse); }

EXPORT int call_leaf(const Call *call) { return find_leaf(call->arm, call->q, call->result); }

/* Minimum joint speed; the gain of the posture in place of the step's. */
EXPORT int call_least_speed(const Call *call) {
  return least_speed(call->arm, call->q, call->xdot, call->posture, call->numbers[1], call->result);
}

static void read_targets(const Call *call, Pose *target) {
  for (int f = 0; f < call->arm->frames; f++)
    for (int i = 0; i < 3; i++) {
      const double *row = call->target + 16 * f + 4 * i;
      for (int k = 0; k < 3; k++) target[f].R[3 * i + k] = row[k];
      target[f].p[i] = row[3];
    }
}

/* bits of given: 1 twist, 2 leaf, 4 limits and damping */
EXPORT int call_step(const Call *call, int given) {
  const Arm *arm = call->arm;
  Pose target[FRAMES];
  Options options;
  read_targets(call, target);
  options.gain = call->numbers[1];
  options.damping = given & 4 ? call->numbers[2] : 0.0;
  options.stay_inside = 0; /* Python checks the region */
  for (int i = 0; i < N; i++) options.limit[i] = given & 4 ? call->limit[i] : HUGE_VAL;
  return take_step(arm, call->q, target, call->numbers[0], given & 1 ? call->twist : NULL,
                   given & 2 ? call->leaf : NULL, &options, (Report *)(call->numbers + 3), call->result);
}

/* Compute G, or qdot, at every row of Q; return the number of rows before the first one that fails. */
EXPORT long call_inverses(const Arm *arm, long count, const double *Q, double *G) {
  long a = 0;
  while (a < count && find_inverse(arm, Q + a * N, G + a * N * M) == OK) a++;
  return a;
}

EXPORT long call_velocities(const Arm *arm, long count, const double *Q, const double *Xdot, double *Qdot) {
  long a = 0;
  while (a < count && find_velocity(arm, Q + a * N, Xdot + a * M, Qdot + a * N) == OK) a++;
  return a;
}

/* Compute J^+ of each Jacobian J (count, M, N); return the number of rows before the first one that fails. */
EXPORT long call_least_inverses(const Arm *arm, long count, const double *J, double *G) {
  long a = 0;
  double rows[M][N];
  for (; a < count; a++) {
    memcpy(rows, J + a * M * N, sizeof(rows));
    if (!inverse_of_rows(arm, rows, G + a * N * M)) break;
  }
  return a;
}

/* Compute the positions and rotations of all frames and the Jacobian at every row of Q; p, R, or J may be NULL. */
EXPORT void call_places(const Arm *arm, long count, const double *Q, double *p, double *R, double *J) {
  for (long a = 0; a < count; a++) {
    double here[3 * MOST_FRAMES], turned[9 * MOST_FRAMES];
    place(arm, Q + a * N, p ? p + 3 * FRAMES * a : here, R ? R + 9 * FRAMES * a : turned,
          J ? (double(*)[N])(J + a * M * N) : NULL);
  }
}
