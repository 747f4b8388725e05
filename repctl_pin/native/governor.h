/* The governor: motions of the frames and levels on straight lines, joints that follow them, and the limits kept.

   A plan is a short motion and a stop after it. It is followed only if all its samples, up to rest, were checked, so
   there is always a known stop. An exported header declares the same structs. */

#ifndef REPCTL_GOVERNOR_H
#define REPCTL_GOVERNOR_H

#include "arm.h"

#ifndef EXPORTED
/* Limits of a governor. */
typedef struct {
  double velocity[MOST_N];     /* rad/s or m/s */
  double acceleration[MOST_N]; /* rad/s^2 or m/s^2 */
  double jerk[MOST_N];         /* rad/s^3 or m/s^3; HUGE_VAL: no limit */
  double margin;               /* distance kept from the joint limits, rad or m */
} Limits;

#define DEGREE 10 /* of the polynomials of a plan */
#define PIECES 24 /* their maximum number */

/* Placements of the frames and levels c of the potentials: what an input asks for. */
typedef struct {
  Pose place[MOST_FRAMES];
  double leaf[MOST_N];
} Goal;

/* The same on the way, with the coordinates of a single frame in a cell, which are not used without one. */
typedef struct {
  Pose place[MOST_FRAMES];
  double y[6], leaf[MOST_N];
} Course;

/* Motion on a straight line: phi(t) = sum C[k] t^k, 6 numbers per frame and one per level; p + phi_v, exp(phi_w) R, or
   y + phi in a cell; c + phi_c. */
typedef struct {
  Course start;
  double C[6][6 * MOST_FRAMES + MOST_N], begin, duration;
} Motion;

/* q(t) = sum C[k] u^k, u from -1 to 1 between two times. */
typedef struct {
  double begin, end, C[DEGREE + 1][MOST_N];
  int degree;
} Piece;

/* Motions of the frames, one after the other to rest, and the joints that follow from them. */
typedef struct {
  Course start;
  Motion motion[3];
  Piece piece[PIECES];
  double q[MOST_N], qdot[MOST_N], time;
  int motions, pieces, lands;
} Plan;

/* Joints of a target: those at the end of the straight line from the start, found step by step. */
typedef struct {
  Motion motion;
  Course course;
  Goal goal;
  double start[MOST_N], q[MOST_N], share, step;
  int begun, known, found;
} Line;

/* State of a governor, owned by the caller. Its members are read and written by its functions only. No function
   allows: every plan within the limits is taken. */
typedef struct {
  Limits limits;
  Plan plan[2];
  Goal landing, heard;
  Pose held[MOST_FRAMES]; /* while levels alone are given */
  double heard_twist[6 * MOST_FRAMES], dt /* of a part of a tick */, stride, leaf[MOST_N], lower[MOST_N], upper[MOST_N], history[3][MOST_N];
  double pace, paced /* before the last plan */, longer, reach;
  Line line;
  long long tick, next, ticks;
  int parts, part, asked, idle, recovers, taken, turn, left, outside, heeds_target, heeds_leaf, holds, stuck, by_joints, exhausted;
  int pending, proposed, refused; /* whether a plan is to be allowed in the next tick; its status; stuck, if it is not */
  int status, cause;
  int started;
  int (*allows)(void *guard, const Plan *plan); /* a status: OK takes a plan */
  void *guard;
} Governor;
#endif

#define TWISTS (6 * FRAMES)        /* coordinates of all frames */
#define RATES (TWISTS + (N - M)) /* these, and the levels */

/* ---- motions of the frames ---- */

SHARED int has_bounds(const Arm *arm);
SHARED int course_holds(const Arm *arm, const Goal *goal);
SHARED void course_begin(const Arm *arm, const double q[], Course *course);
SHARED void course_at(const Arm *arm, const double q[], Course *course);
SHARED void course_rates_of(const Arm *arm, const Course *course, const double rate[], double way[]);
SHARED void course_way(const Arm *arm, const Course *course, const Goal *goal, double way[]);
SHARED void course_rates(const Arm *arm, const Course *course, const double twist[], double rate[]);
SHARED void course_task_rates(const Arm *arm, const Course *course, double E[]);
SHARED void motion_course_at(const Arm *arm, const Motion *motion, double t, Course *course);
SHARED void motion_rates(const Arm *arm, const Motion *motion, double t, double twist[], double rate[]);
SHARED void motion_begin(const Arm *arm, Motion *motion, const Course *start, const double twist[], const double rate[],
                         double time);
SHARED void motion_change(const Arm *arm, Motion *motion, const Course *start, const double twist[],
                          const double rate[], const double later[], double time);
SHARED void motion_brake(const Arm *arm, Motion *motion, const Course *start, const double twist[], const double rate[],
                         double time);
SHARED void motion_land(const Arm *arm, Motion *motion, const Course *start, const double twist[], const double rate[],
                        const double way[], double time);
SHARED double longest_landing(double speed, double a);

/* ---- plans of the joints ---- */

SHARED const Piece *piece_of(const Plan *plan, double t);
SHARED void piece_at(const Arm *arm, const Piece *piece, double t, double q[]);
SHARED void piece_derivatives(const Arm *arm, const Piece *piece, double t, double qdot[], double qddot[]);
SHARED void plan_at(const Arm *arm, const Plan *plan, double t, double q[]);
SHARED void plan_rates(const Arm *arm, const Plan *plan, double t, double twist[], double rate[]);
SHARED void plan_course_at(const Arm *arm, const Plan *plan, double t, Course *course);
SHARED void plan_begin(const Arm *arm, Plan *plan, const Course *start, const double q[], const double qdot[]);
SHARED int plan_append(const Arm *arm, Governor *g, Plan *plan, int table, int count);
SHARED void plan_back(const Arm *arm, const Governor *g, const double q[], const double inside[], Plan *plan);

/* ---- configurations of targets ---- */

SHARED void copy_goal(const Arm *arm, const Goal *from, Goal *to);
SHARED int equal_goals(const Arm *arm, const Goal *a, const Goal *b);
SHARED void look_for(const Arm *arm, Governor *g, const Goal *goal);
SHARED int is_there(const Arm *arm, Governor *g, const double q[]);
SHARED double regularity(const Arm *arm, const double q[]);
SHARED void leaf_direction(const Arm *arm, const double q[], const double goal[], double d[]);

/* ---- the governor; both return a status ---- */

SHARED int govern_from(const Arm *arm, Governor *g, const double q[], double dt, const Limits *limits);
SHARED int govern(const Arm *arm, Governor *g, const Pose *target, const double *twist, const double *leaf,
                  double q_next[]);

#endif
