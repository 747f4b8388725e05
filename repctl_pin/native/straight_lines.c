/* Motions on straight lines: of the frames in space, or, of one frame, in the coordinates of the cell that is the
   region, and of the levels c. */

#include <math.h>
#include <stddef.h>

#include "chart.h"
#include "governor.h"

#ifdef CHART
#define CELL_OF(arm) ((arm)->region ? (arm)->region->chart : NULL)
#else
#define CELL_OF(arm) NULL
#endif

/* ---- rotations ---- */

static void cross(const double x[3], const double y[3], double z[3]) {
  z[0] = x[1] * y[2] - x[2] * y[1];
  z[1] = x[2] * y[0] - x[0] * y[2];
  z[2] = x[0] * y[1] - x[1] * y[0];
}

/* R <- exp(w) R0. */
static void turn_rotation(const double w[3], const double R0[9], double R[9]) {
  const double s = w[0] * w[0] + w[1] * w[1] + w[2] * w[2], angle = sqrt(s);
  const double a = s < 1e-4 ? 1.0 - s / 6.0 + s * s / 120.0 : sin(angle) / angle;
  const double b = s < 1e-4 ? 0.5 - s / 24.0 + s * s / 720.0 : (1.0 - cos(angle)) / s;
  double E[9];
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 3; k++) E[3 * i + k] = b * w[i] * w[k] + (i == k ? 1.0 - b * s : 0.0);
  E[1] -= a * w[2];
  E[2] += a * w[1];
  E[3] += a * w[2];
  E[5] -= a * w[0];
  E[6] -= a * w[1];
  E[7] += a * w[0];
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 3; k++)
      R[3 * i + k] = E[3 * i] * R0[k] + E[3 * i + 1] * R0[3 + k] + E[3 * i + 2] * R0[6 + k];
}

/* Convert the two derivatives of a rotation vector, in place, to the angular velocity and its derivative. */
static void angular_rates(const double w[3], double w1[3], double w2[3]) {
  const double s = w[0] * w[0] + w[1] * w[1] + w[2] * w[2];
  const double rate = 2.0 * (w[0] * w1[0] + w[1] * w1[1] + w[2] * w1[2]);
  double a, b, da, db, c1[3], c2[3], cc1[3], cc2[3], d[3];
  if (s < 0.05) {
    a = 0.5 - s / 24.0 + s * s / 720.0 - s * s * s / 40320.0;
    b = 1.0 / 6.0 - s / 120.0 + s * s / 5040.0 - s * s * s / 362880.0;
    da = -1.0 / 24.0 + s / 360.0 - s * s / 13440.0;
    db = -1.0 / 120.0 + s / 2520.0 - s * s / 120960.0;
  } else {
    const double angle = sqrt(s), cosine = cos(angle), sinc = sin(angle) / angle;
    a = (1.0 - cosine) / s;
    b = (1.0 - sinc) / s;
    da = (sinc / 2.0 - a) / s;
    db = (-(cosine - sinc) / (2.0 * s) - b) / s;
  }
  cross(w, w1, c1);
  cross(w, w2, c2);
  cross(w, c1, cc1);
  cross(w, c2, cc2);
  cross(w1, c1, d);
  for (int i = 0; i < 3; i++) {
    w1[i] = w1[i] + a * c1[i] + b * cc1[i];
    w2[i] = w2[i] + a * c2[i] + b * (d[i] + cc2[i]) + rate * (da * c1[i] + db * cc1[i]);
  }
}

/* ---- coordinates of straight lines ---- */

/* Tell whether the coordinates have bounds, those of a cell. */
SHARED int has_bounds(const Arm *arm) {
  (void)arm;
  return CELL_OF(arm) != NULL;
}

/* Tell whether a target is inside the bounds of the coordinates. */
SHARED int course_holds(const Arm *arm, const Goal *goal) {
  (void)arm, (void)goal;
#ifdef CHART
  if (CELL_OF(arm)) return in_cell(arm, CELL_OF(arm), goal->place->p, goal->place->R);
#endif
  return 1;
}

/* Find the course of the frames at q, without one before. */
SHARED void course_begin(const Arm *arm, const double q[], Course *course) {
  find_poses(arm, q, course->place);
  for (int i = 0; i < 6; i++) course->y[i] = 0.0;
#ifdef CHART
  if (CELL_OF(arm)) cell_coordinates(arm, CELL_OF(arm), course->place, course->y);
#endif
}

/* Find the course at q next to a course, which gives its coordinates up to full turns, and the levels. */
SHARED void course_at(const Arm *arm, const double q[], Course *course) {
  double before[6];
  for (int i = 0; i < 6; i++) before[i] = course->y[i];
  course_begin(arm, q, course);
  if (CELL_OF(arm)) {
    const double turn = 6.283185307179586;
    for (int i = 0; i < 6; i++) course->y[i] -= turn * rint((course->y[i] - before[i]) / turn);
  }
}

/* Move a course by phi: p + phi_v, exp(phi_w) R, or y + phi in a cell. */
static void course_shifted(const Arm *arm, const Course *start, const double phi[], Course *course) {
  (void)arm;
  for (int i = 0; i < 6; i++) course->y[i] = CELL_OF(arm) ? start->y[i] + phi[i] : 0.0;
  for (int k = 0; k < N - M; k++) course->leaf[k] = start->leaf[k] + phi[TWISTS + k];
#ifdef CHART
  if (CELL_OF(arm)) {
    cell_place(arm, CELL_OF(arm), course->y, course->place);
    return;
  }
#endif
  for (int f = 0; f < FRAMES; f++) {
    for (int i = 0; i < 3; i++) course->place[f].p[i] = start->place[f].p[i] + phi[6 * f + i];
    turn_rotation(phi + 6 * f + 3, start->place[f].R, course->place[f].R);
  }
}

/* Convert the velocity of one frame's rows to its twist, 0 in the coordinates that the task does not have. */
static void frame_twist(const Arm *arm, const double R[9], const double rate[], double twist[6]) {
  for (int i = 0; i < ROWS && i < 3; i++) twist[arm->kind == POSITION ? arm->rows[i] : i] = rate[i];
  for (int i = 0; i < 3; i++) {
    if (arm->kind == POSE) twist[3 + i] = rate[3 + i];
    if (arm->kind == AXIS) twist[3 + i] = R[3 * i] * rate[3] + R[3 * i + 1] * rate[4];
  }
}

/* Convert a task velocity to one of the coordinates, 0 in those that the task does not have or the cell fixes, and of
   the levels. */
SHARED void course_rates_of(const Arm *arm, const Course *course, const double rate[], double way[]) {
  for (int i = 0; i < RATES; i++) way[i] = 0.0;
#ifdef CHART
  if (CELL_OF(arm)) {
    const Chart *cell = CELL_OF(arm);
    for (int i = 0; i < M; i++) {
      double d[M];
      if (!(cell->lower[i] < cell->upper[i])) continue;
      for (int a = 0; a < M; a++) d[a] = a == i;
      cell_rates(arm, cell, course->place->R, course->y, d);
      for (int a = 0; a < M; a++) way[i] += d[a] * rate[a];
    }
    return;
  }
#endif
  for (int f = 0; f < FRAMES; rate += FRAME(f)->m, f++)
    frame_twist(FRAME(f), course->place[f].R, rate, way + 6 * f);
}

/* Compute the displacement of the frames to a target, or to the nearest placement in the cell. */
static void frames_way(const Arm *arm, const Course *course, const Pose *target, double way[]) {
  double e[M];
#ifdef CHART
  if (CELL_OF(arm)) {
    const Chart *cell = CELL_OF(arm);
    cell_coordinates(arm, cell, target, e);
    for (int i = 0; i < TWISTS; i++) way[i] = 0.0;
    for (int i = 0; i < M; i++) {
      double nearest = e[i] < cell->upper[i] ? e[i] : cell->upper[i];
      if (!(nearest > cell->lower[i])) nearest = cell->lower[i];
      way[i] = nearest - course->y[i];
    }
    return;
  }
#endif
  for (int f = 0, row = 0; f < FRAMES; row += FRAME(f)->m, f++)
    frame_error(FRAME(f), course->place[f].p, course->place[f].R, target + f, e + row);
  course_rates_of(arm, course, e, way);
}

/* Compute the displacement to a goal. */
SHARED void course_way(const Arm *arm, const Course *course, const Goal *goal, double way[]) {
  frames_way(arm, course, goal->place, way);
  for (int k = 0; k < N - M; k++) way[TWISTS + k] = goal->leaf[k] - course->leaf[k];
}

/* Convert the frames' twists to a task velocity. */
SHARED void course_rates(const Arm *arm, const Course *course, const double twist[], double rate[]) {
  for (int a = 0; a < M; a++) rate[a] = 0.0;
  for (int f = 0; f < FRAMES; rate += FRAME(f)->m, f++)
    add_frame_rate(FRAME(f), course->place[f].R, twist + 6 * f, 1.0, rate);
}

/* Evaluate the task velocity per unit of each coordinate of the frames, E (M, TWISTS). */
SHARED void course_task_rates(const Arm *arm, const Course *course, double E[]) {
  for (int b = 0; b < TWISTS; b++) {
    double twist[TWISTS], rate[M];
    for (int i = 0; i < TWISTS; i++) twist[i] = i == b && !CELL_OF(arm);
#ifdef CHART
    if (CELL_OF(arm) && b < M) cell_twist(arm, CELL_OF(arm), course->y, b, twist);
#endif
    course_rates(arm, course, twist, rate);
    for (int a = 0; a < M; a++) E[a * TWISTS + b] = rate[a];
  }
}

/* ---- motions: polynomials of the coordinates in time ---- */

static void displacement(const Arm *arm, const Motion *motion, double t, double phi[]) {
  (void)arm;
  for (int i = 0; i < RATES; i++)
    phi[i] = ((((motion->C[5][i] * t + motion->C[4][i]) * t + motion->C[3][i]) * t + motion->C[2][i]) * t
              + motion->C[1][i]) * t;
}

SHARED void motion_course_at(const Arm *arm, const Motion *motion, double t, Course *course) {
  double phi[RATES];
  displacement(arm, motion, t, phi);
  course_shifted(arm, &motion->start, phi, course);
}

/* Evaluate the velocity of a motion in the coordinates of its course, and its derivative. */
SHARED void motion_rates(const Arm *arm, const Motion *motion, double t, double twist[], double rate[]) {
  double phi[RATES];
  displacement(arm, motion, t, phi);
  for (int i = 0; i < RATES; i++) {
    const double c2 = motion->C[2][i], c3 = motion->C[3][i], c4 = motion->C[4][i], c5 = motion->C[5][i];
    twist[i] = (((5.0 * c5 * t + 4.0 * c4) * t + 3.0 * c3) * t + 2.0 * c2) * t + motion->C[1][i];
    rate[i] = ((20.0 * c5 * t + 12.0 * c4) * t + 6.0 * c3) * t + 2.0 * c2;
  }
  for (int i = 3; i < TWISTS && !CELL_OF(arm); i += 6)
    angular_rates(phi + i, twist + i, rate + i);
}

/* Begin a motion with a twist and its derivative. */
SHARED void motion_begin(const Arm *arm, Motion *motion, const Course *start, const double twist[], const double rate[],
                         double time) {
  (void)arm;
  motion->start = *start;
  motion->duration = time;
  for (int i = 0; i < RATES; i++) {
    motion->C[0][i] = motion->C[3][i] = motion->C[4][i] = motion->C[5][i] = 0.0;
    motion->C[1][i] = twist[i];
    motion->C[2][i] = rate[i] / 2.0;
  }
}

/* Change the derivative of the twist linearly to another one. */
SHARED void motion_change(const Arm *arm, Motion *motion, const Course *start, const double twist[],
                          const double rate[], const double later[], double time) {
  motion_begin(arm, motion, start, twist, rate, time);
  for (int i = 0; i < RATES; i++) motion->C[3][i] = (later[i] - rate[i]) / (6.0 * time);
}

/* Bring a twist and its derivative to 0: cubic in time. */
SHARED void motion_brake(const Arm *arm, Motion *motion, const Course *start, const double twist[], const double rate[],
                         double time) {
  motion_begin(arm, motion, start, twist, rate, time);
  for (int i = 0; i < RATES; i++) {
    motion->C[3][i] = -twist[i] / (time * time) - 2.0 * rate[i] / (3.0 * time);
    motion->C[4][i] = twist[i] / (2.0 * time * time * time) + rate[i] / (4.0 * time * time);
  }
}

/* Come to rest after a displacement: quintic in time. */
SHARED void motion_land(const Arm *arm, Motion *motion, const Course *start, const double twist[], const double rate[],
                        const double way[], double time) {
  const double square = time * time, cube = square * time;
  motion_begin(arm, motion, start, twist, rate, time);
  for (int i = 0; i < RATES; i++) {
    const double D = way[i] - time * twist[i] - square / 2.0 * rate[i], V = -twist[i] - time * rate[i];
    motion->C[3][i] = (10.0 * D - 4.0 * time * V - square / 2.0 * rate[i]) / cube;
    motion->C[4][i] = (-15.0 * D + 7.0 * time * V + square * rate[i]) / (cube * time);
    motion->C[5][i] = (6.0 * D - 3.0 * time * V - square / 2.0 * rate[i]) / (cube * square);
  }
}

/* Time beyond which the quintic to rest over the distance 1 overshoots: its last derivatives are 0, 0 and
   (60 - 24 T speed - 3 T^2 a) / T^3. */
SHARED double longest_landing(double speed, double a) {
  const double root = 4.0 * speed * speed + 5.0 * a;
  const double rate = root >= 0.0 ? 2.0 * speed + sqrt(root) : 0.0;
  return rate > 0.0 ? 10.0 / rate : HUGE_VAL;
}
