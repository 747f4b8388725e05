/* Configurations of targets on a leaf, and the way to them along it. */

#include <math.h>
#include <stddef.h>

#include "governor.h"
#include "law.h"

#define LONGEST_STEP 0.1  /* motion of a joint per step of the continuation, rad or m */
#define CONTRACTION 0.25  /* ratio of a Newton step to the one before; beyond it lies perhaps another branch */
#define MOST_AT_ONCE 40   /* evaluations of a tick */
#define NEAR_SINGULAR 0.05 /* regularity below which the way does not lead nearer to a singularity */
#define PUSH 0.5          /* sine of the angle by which it leads away from the singularity, at most */

SHARED void copy_poses(const Arm *arm, const Pose *from, Pose *to) {
  (void)arm;
  for (int f = 0; f < FRAMES; f++) to[f] = from[f];
}

SHARED int equal_poses(const Arm *arm, const Pose *a, const Pose *b) {
  (void)arm;
  for (int f = 0; f < FRAMES; f++) {
    for (int i = 0; i < 3; i++)
      if (a[f].p[i] != b[f].p[i]) return 0;
    for (int i = 0; i < 9; i++)
      if (a[f].R[i] != b[f].R[i]) return 0;
  }
  return 1;
}

/* Begin with the straight line from the start to a target. */
static void line_begin(const Arm *arm, Governor *g, const Pose *target) {
  Line *line = &g->line;
  static const double zero[6 * MOST_FRAMES] = {0.0};
  double way[RATES];
  course_way(arm, &line->course, target, way);
  motion_begin(arm, &line->motion, &line->course, way, zero, 1.0);
  copy_poses(arm, target, line->target);
  line->share = 0.0;
  line->step = line->begun = 1;
  line->known = line->found = 0;
  for (int i = 0; i < N; i++) line->q[i] = line->start[i];
}

/* Solve f(q) = x, h(q) = c next to q, inside all limits. */
static int line_solved(const Arm *arm, const Governor *g, const Pose *target, double q[], int *left) {
  double before = HUGE_VAL;
  for (int k = 0; k < 6; k++) {
    double x[N], size = 0.0, most = CONTRACTION * before < LONGEST_STEP ? CONTRACTION * before : LONGEST_STEP;
    --*left;
    if (take_step(arm, q, target, 1.0, NULL, g->leaf, NULL, NULL, x) != OK) return 0;
    for (int i = 0; i < N; i++) {
      if (!(fabs(x[i] - q[i]) <= size)) size = fabs(x[i] - q[i]);
      q[i] = x[i];
    }
    if (!(size <= (most > 1e-6 ? most : 1e-6))) return 0;
    if (size < 1e-6) {
      for (int i = 0; i < N; i++)
        if (!(q[i] >= g->lower[i] && q[i] <= g->upper[i])) return 0;
      return find_inside(arm, q) == OK;
    }
    before = size;
  }
  return 0;
}

/* Go on with the joints of a target: continuation along the straight line from the start, by a number of evaluations. */
SHARED void look_for(const Arm *arm, Governor *g, const Pose *target) {
  Line *line = &g->line;
  int left = MOST_AT_ONCE;
  if (!line->begun || !equal_poses(arm, target, line->target)) line_begin(arm, g, target);
  while (!line->known && left > 0) {
    const double end = line->share + line->step < 1.0 ? line->share + line->step : 1.0;
    double q[N];
    Course course;
    for (int i = 0; i < N; i++) q[i] = line->q[i];
    motion_course_at(arm, &line->motion, end, &course);
    if (!line_solved(arm, g, course.place, q, &left)) {
      line->step /= 2.0;
      line->known = line->step < 1e-3;
      continue;
    }
    for (int i = 0; i < N; i++) line->q[i] = q[i];
    line->share = end;
    line->step *= 2.0;
    line->known = line->found = end == 1.0;
  }
}

/* Tell whether the joints at a target are those of the target; if not, take the way there. */
SHARED int is_there(const Arm *arm, Governor *g, const double q[]) {
  const Line *line = &g->line;
  (void)arm;
  for (int i = 0; line->found && i < N; i++)
    if (!(fabs(q[i] - line->q[i]) <= 1e-7)) g->by_joints = 1;
  return line->known && !g->by_joints;
}

/* Smallest sine of the angle between a row of J and the other rows of J_V; 0 is singular. */
SHARED double regularity(const Arm *arm, const double q[]) {
  double p[3 * FRAMES], R[9 * FRAMES], J[M][N], G[N * M], worst = 0.0;
  if (find_inverse(arm, q, G) != OK) return 0.0;
  place(arm, q, p, R, J);
  for (int a = 0; a < M; a++) {
    double row = 0.0, column = 0.0;
    for (int i = 0; i < N; i++) {
      row += J[a][i] * J[a][i];
      column += G[i * M + a] * G[i * M + a];
    }
    if (!(row * column <= worst)) worst = row * column;
  }
  return 1.0 / sqrt(worst);
}

/* Remove from x its parts along V[0], V[1], ..., which are orthonormal. */
static void project(const Arm *arm, double V[][N], int count, double x[]) {
  (void)arm;
  for (int k = 0; k < count; k++) {
    double part = 0.0;
    for (int i = 0; i < N; i++) part += V[k][i] * x[i];
    for (int i = 0; i < N; i++) x[i] -= part * V[k][i];
  }
}

/* Direct q towards a goal on its leaf: (I - V V+)(goal - q), and along a singularity if one is near. */
SHARED void leaf_direction(const Arm *arm, const double q[], const double goal[], double d[]) {
  double V[N - M][N], h[N - M], slope[N], at[N], square = 0.0, size = 0.0, along = 0.0, push;
  double p[3 * FRAMES], R[9 * FRAMES], J[M][N];
  const double here = regularity(arm, q);
  place(arm, q, p, R, J);
  potentials(arm, q, p, R, J, h, V);
  for (int k = 0; k < N - M; k++) {
    double length = 0.0;
    project(arm, V, k, V[k]);
    for (int i = 0; i < N; i++) length += V[k][i] * V[k][i];
    for (int i = 0; i < N; i++) V[k][i] /= sqrt(length);
  }
  for (int i = 0; i < N; i++) d[i] = goal[i] - q[i];
  project(arm, V, N - M, d);
  if (here >= NEAR_SINGULAR) return;
  for (int i = 0; i < N; i++) at[i] = q[i];
  for (int i = 0; i < N; i++) {
    at[i] = q[i] + 1e-5;
    slope[i] = (regularity(arm, at) - here) / 1e-5;
    at[i] = q[i];
  }
  project(arm, V, N - M, slope);
  for (int i = 0; i < N; i++) {
    square += slope[i] * slope[i];
    size += d[i] * d[i];
    along += slope[i] * d[i];
  }
  if (!(square >= 1e-300)) square = 1e-300;
  push = PUSH * (1.0 - here / NEAR_SINGULAR) * sqrt(square * size) - along;
  if (!(push > 0.0)) return;
  for (int i = 0; i < N; i++) d[i] += push / square * slope[i];
}
