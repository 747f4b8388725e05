/* The governor and the torque law as Python calls them. */

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "governor.h"
#include "torque.h"

typedef struct {
  int room; /* samples of a plan, at most */
  double dt;
  const Arm *arm;
  Governor *state;         /* governor_bytes() */
  const double *limits;    /* 3 N + 1: velocity, acceleration, jerk; margin */
  const double *target;    /* 16 FRAMES: [R p; 0 1] by rows */
  const double *twist, *leaf; /* 6 FRAMES, N - M */
  const double *q;            /* N: where it begins */
  double *result;          /* N */
  double *samples, *ways;  /* room N: of a plan, and the ways of the joints up to them */
  Governor *kept;          /* governor_bytes(): the state before a tick that may fail */
  double *last;            /* N: the command then */
  int (*allows)(int count, int first); /* first: of the questions about the next motion */
} GovernorCall;

EXPORT long governor_bytes(void) { return (long)sizeof(Governor); }

static void read_poses(const Arm *arm, const double *rows, Pose pose[]) {
  for (int f = 0; f < FRAMES; f++)
    for (int i = 0; i < 3; i++) {
      const double *row = rows + 16 * f + 4 * i;
      for (int k = 0; k < 3; k++) pose[f].R[3 * i + k] = row[k];
      pose[f].p[i] = row[3];
    }
}

EXPORT int call_governor_start(const GovernorCall *call) {
  const Arm *arm = call->arm;
  Limits limits;
  for (int i = 0; i < N; i++) {
    limits.velocity[i] = call->limits[i];
    limits.acceleration[i] = call->limits[N + i];
    limits.jerk[i] = call->limits[2 * N + i];
  }
  limits.margin = call->limits[3 * N];
  return govern_from(arm, call->state, call->q, call->dt, &limits);
}

/* Sample a plan, from the last command to rest, and ask whether it is allowed. From tick to tick the joints move on a
   straight line. Ticks of many parts are longer, so their lines are divided: there are about as many samples. */
static int ask(void *guard, const Plan *plan) {
  const GovernorCall *call = (const GovernorCall *)guard;
  const Arm *arm = call->arm;
  Governor *g = call->state;
  const double first = (double)(g->parts - g->part); /* the parts up to the next tick */
  const long ticks = (long)ceil((plan->time / g->dt - first) / g->parts) + 1, most = call->room - 1;
  const long stride = ticks > most ? (ticks - 1) / most + 1 : 1;
  const long pieces = g->parts > 1 && ticks < most ? most / ticks : 1;
  double q[N], way[N];
  int count = 1;
  for (int i = 0; i < N; i++) {
    call->samples[i] = q[i] = call->result[i];
    call->ways[i] = way[i] = 0.0;
  }
  for (long k = 1; k <= ticks; k++) {
    double next[N];
    plan_at(arm, plan, (first + (double)(k - 1) * g->parts) * g->dt, next);
    for (long s = 1; s <= pieces; s++) {
      const double share = (double)s / (double)pieces;
      if (k % stride != 0 && k != ticks) continue;
      for (int i = 0; i < N; i++) {
        call->samples[count * N + i] = s == pieces ? next[i] : q[i] + share * (next[i] - q[i]);
        call->ways[count * N + i] = way[i] + share * fabs(next[i] - q[i]);
      }
      count++;
    }
    for (int i = 0; i < N; i++) {
      way[i] += fabs(next[i] - q[i]);
      q[i] = next[i];
    }
  }
  return call->allows(count, g->asked++ == 0) == 1 ? OK : BODIES;
}

/* Copy a state. A tick of one part writes a plan or asks about one, and before it writes one, there is none to lose: its
   plans, nine tenths of the state, need no copy. */
static void copy_state(const Governor *from, Governor *to) {
  const size_t plans = offsetof(Governor, plan), rest = offsetof(Governor, landing);
  memcpy(to, from, plans);
  if (from->parts > 1) memcpy(to->plan, from->plan, sizeof(from->plan));
  memcpy((char *)to + rest, (const char *)from + rest, sizeof(Governor) - rest);
}

/* Keep the state and the command, and go back to them after a tick that failed. */
EXPORT void call_governor_keep(const GovernorCall *call) {
  const Arm *arm = call->arm;
  copy_state(call->state, call->kept);
  memcpy(call->last, call->result, N * sizeof(double));
}

EXPORT void call_governor_undo(const GovernorCall *call) {
  const Arm *arm = call->arm;
  copy_state(call->kept, call->state);
  memcpy(call->result, call->last, N * sizeof(double));
}

/* bits of given: 1 target, 2 twist, 4 leaf */
EXPORT int call_governor_step(const GovernorCall *call, int given) {
  const Arm *arm = call->arm;
  Pose target[FRAMES];
  read_poses(arm, call->target, target);
  call->state->allows = call->allows ? ask : NULL;
  call->state->guard = (void *)call;
  return govern(arm, call->state, given & 1 ? target : NULL, given & 2 ? call->twist : NULL,
                given & 4 ? call->leaf : NULL, call->result);
}

typedef struct {
  const Arm *arm;
  const double *q, *qdot, *inertia, *bias; /* N, N, N N, N */
  const double *target, *twist, *leaf;     /* 16 FRAMES, 6 FRAMES, N - M */
  const double *gains;                     /* M + N + 4: stiffness, observer_limit, the numbers */
  double *result;                          /* N */
} TorqueCall;

EXPORT int call_torque(const TorqueCall *call, int twist, double dt, double *observer) {
  const Arm *arm = call->arm;
  const double *numbers = call->gains + M + N;
  Pose target[FRAMES];
  Gains gains;
  read_poses(arm, call->target, target);
  for (int i = 0; i < M; i++) gains.stiffness[i] = call->gains[i];
  for (int i = 0; i < N; i++) gains.observer_limit[i] = call->gains[M + i];
  gains.damping = numbers[0];
  gains.leaf_frequency = numbers[1];
  gains.leaf_damping = numbers[2];
  gains.observer_rate = numbers[3];
  return joint_torques(arm, call->q, call->qdot, call->inertia, call->bias, target, twist ? call->twist : NULL,
                     call->leaf, &gains, dt, observer, call->result);
}
