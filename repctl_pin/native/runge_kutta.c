/* Runge-Kutta steps of two control laws along task velocities that are the same in every cycle: minimum joint speed, and
   that of a repeatable inverse. Both stop before a step whose velocity Python has to compute, or to refuse. */

#include <math.h>
#include <string.h>

#include "law.h"
#include "least_speed.h"

typedef struct {
  const Arm *arm;
  int stages, steps, on_leaf;    /* of the method, of a cycle; 1: the law of the potentials */
  double gain;                   /* of the posture, 1/s */
  const double *posture;         /* N; NULL: none */
  const double *nodes, *weights; /* stages: c and b of the tableau */
  const double *xdot, *h, *most; /* steps stages M, steps, N: of each stage, s, rad or m per step */
} Law;

static int law_velocity(const Law *law, const double *q, const double *xdot, double *qdot) {
  if (law->on_leaf) return find_velocity(law->arm, q, xdot, qdot) == OK;
  return least_speed(law->arm, q, xdot, law->posture, law->gain, qdot);
}

/* Step from row `step` of Q on; return the first step that is not done. */
EXPORT int runge_kutta_steps(const Law *law, int step, int end, double *Q, double *Qdot) {
  const Arm *arm = law->arm;
  const int stages = law->stages;
  double slopes[stages][N], at[N];
  for (; step < end; step++) {
    const double *q = Q + (long)step * N, *xdot = law->xdot + (long)(step % law->steps) * stages * M;
    double *next = Q + (long)(step + 1) * N, h = law->h[step % law->steps];
    for (int i = 0; i < stages; i++) {
      for (int k = 0; k < N; k++) at[k] = i ? q[k] + h * law->nodes[i] * slopes[i - 1][k] : q[k];
      if (!law_velocity(law, at, xdot + i * M, slopes[i])) return step;
    }
    for (int k = 0; k < N; k++) {
      double sum = 0;
      for (int i = 0; i < stages; i++) sum += law->weights[i] * slopes[i][k];
      next[k] = q[k] + h * sum;
      if (!(fabs(next[k] - q[k]) < law->most[k])) return step;
    }
    memcpy(Qdot + (long)step * N, slopes[0], sizeof slopes[0]);
  }
  return step;
}
