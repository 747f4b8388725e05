/* The governor: the next joints to command, for a pose and levels, within all limits. */

#include <math.h>
#include <stddef.h>

#include "governor.h"
#include "law.h"

#define TINY 1e-300
#define STRIDE 0.004 /* time between two plans, s */
#define PART 0.001   /* longest part of a tick, s */
#define SHORTEST 1e-4 /* tick, s: in shorter ones, rounding has a share of the jerk limit */
#define LONGEST 0.1   /* tick, s */
#define WITHIN 1e-12  /* distance kept from the limits beyond the margin, for rounding, rad or m */
#define FAR 1e6       /* positions and twists beyond are refused, m, m/s and rad/s */
#define MOST_IDLE 250 /* plans in a row that an arm at rest does not find, before it is said to be stopped */

/* How far beyond a joint limit an arm can start, rad or m. */
#define BEYOND 0.1

/* Shares of the limits that plans aim at; the remainder is for the change of G along the path. */
#define AIM_SPEED 0.985
#define AIM_ACCELERATION 0.95
#define AIM_JERK 0.8
#define AIM_BRAKING 0.75 /* before targets and joint limits */

#define REGULAR 0.01 /* regularity of the configuration in which a plan ends, at least: nearer to a singularity, an arm
                        at rest could not leave it */
#define MOST_EVALUATIONS 130          /* of a tick */
#define SAMPLES_PER_EVALUATION 16.0   /* samples of a plan that take as long as an evaluation */
#define MOST_SAMPLES 40               /* what they count at most */

/* What a tick asks for: a pose or twists of the frames, and levels. */
typedef struct {
  Goal goal;
  const double *twist;
  int to_pose, to_leaf;
} Input;

/* State at the beginning of a plan: qdot = B twist, qddot = B rate + bend, where twist and rate are those of the frames
   and levels; later: the rate of the last stop after a stride. */
typedef struct {
  Course course;
  double *G, *B, *B_ahead; /* N N: J_V^-1; N RATES, N RATES: in memory of the caller */
  double q[MOST_N], qdot[MOST_N], bend[MOST_N], room[MOST_N];
  double twist[6 * MOST_FRAMES + MOST_N], rate[6 * MOST_FRAMES + MOST_N], later[6 * MOST_FRAMES + MOST_N];
} Now;

/* Speed from which a deceleration a after a delay stops within a distance; a can be infinite. */
static double approach_speed(double distance, double a, double lag) {
  if (distance <= 0.0) return 0.0;
  if (lag * lag * a > 1e12 * distance) return distance / lag;
  return a * (sqrt(lag * lag + 2.0 * distance / a) - lag);
}

/* Acceleration beyond which a stop within a distance becomes no shorter. */
static double peak_acceleration(double distance, double jerk) { return cbrt(jerk * jerk * distance); }

/* Speed from which a stop after a delay ends within a distance: the deceleration rises to at most a and falls to 0 at a
   rate of at most jerk. */
static double arrival_speed(double distance, double a, double jerk, double lag) {
  if (distance <= 0.0) return 0.0;
  if (peak_acceleration(distance, jerk) < a) a = peak_acceleration(distance, jerk);
  return approach_speed(distance, a, lag + a / (2.0 * jerk));
}

/* Compute B x for a velocity x in the coordinates of the course. */
static void joint_rates(const Arm *arm, const double *B, const double twist[], double x[]) {
  (void)arm;
  for (int i = 0; i < N; i++) {
    x[i] = 0.0;
    for (int a = 0; a < RATES; a++) x[i] += B[i * RATES + a] * twist[a];
  }
}

/* B = J_V^-1 [E 0; 0 I]. */
static void joint_columns(const Arm *arm, const double *G, const double *E, double *B) {
  (void)arm;
  for (int i = 0; i < N; i++) {
    for (int b = 0; b < TWISTS; b++) {
      B[i * RATES + b] = 0.0;
      for (int a = 0; a < M; a++) B[i * RATES + b] += G[i * N + a] * E[a * TWISTS + b];
    }
    for (int k = 0; k < N - M; k++) B[i * RATES + TWISTS + k] = G[i * N + M + k];
  }
}

/* Evaluate the state at this tick; return 0 at a singularity. */
static int state_now(const Arm *arm, const Governor *g, Now *now) {
  const Plan *plan = &g->plan[g->taken];
  const double t = (double)g->tick * g->dt;
  const Piece *piece = piece_of(plan, t);
  double ahead[N], qddot[N], spare[RATES], x[N], E[M * TWISTS], G[N * N];
  for (int i = 0; i < N; i++) {
    now->q[i] = g->history[2][i];
    now->qdot[i] = qddot[i] = 0.0;
  }
  plan_course_at(arm, plan, t, &now->course);
  course_at(arm, now->q, &now->course);
  plan_rates(arm, plan, t, now->twist, now->rate);
  plan_rates(arm, plan, t + g->stride, spare, now->later);
  if (piece) piece_derivatives(arm, piece, t, now->qdot, qddot);
  for (int i = 0; i < N; i++) ahead[i] = now->q[i] + 2.0 * g->stride * now->qdot[i];
  if (find_columns(arm, now->q, N, now->G) != OK || find_columns(arm, ahead, N, G) != OK) return 0;
  course_task_rates(arm, &now->course, E);
  joint_columns(arm, now->G, E, now->B);
  joint_columns(arm, G, E, now->B_ahead);
  joint_rates(arm, now->B, now->rate, x);
  for (int i = 0; i < N; i++) {
    const double A = g->limits.acceleration[i];
    now->bend[i] = qddot[i] - x[i];
    now->room[i] = A - fabs(now->bend[i]) > 0.3 * A ? A - fabs(now->bend[i]) : 0.3 * A;
  }
  return 1;
}

/* Find the largest speeds along a direction, in shares of it per s: by the speed limits, and by the joint limits. */
static void fastest_along(const Arm *arm, const Governor *g, const Now *now, const double way[], double *by_speed,
            double *by_room) {
  double x[N], ahead[N];
  joint_rates(arm, now->B, way, x);
  joint_rates(arm, now->B_ahead, way, ahead);
  *by_speed = *by_room = HUGE_VAL;
  for (int i = 0; i < N; i++) {
    const double room = x[i] > 0.0 ? g->upper[i] - now->q[i] : now->q[i] - g->lower[i];
    const double here = fabs(x[i]) > TINY ? fabs(x[i]) : TINY;
    const double size = fabs(ahead[i]) > here ? fabs(ahead[i]) : here;
    const double a = AIM_BRAKING * g->limits.acceleration[i], jerk = AIM_JERK * g->limits.jerk[i];
    const double toward = arrival_speed(room, a, jerk, 2.0 * g->stride) / here;
    const double speed = AIM_SPEED * g->limits.velocity[i] / size;
    if (speed < *by_speed) *by_speed = speed;
    if (toward < *by_room) *by_room = toward;
  }
}

/* Compute the deceleration before a target and its largest rate of change, in shares of the joint displacement x. */
static double braking_rate(const Arm *arm, const Governor *g, const Now *now, const double x[], double *jerk) {
  double a = HUGE_VAL;
  (void)arm;
  *jerk = HUGE_VAL;
  for (int i = 0; i < N; i++) {
    const double size = fabs(x[i]) > TINY ? fabs(x[i]) : TINY;
    if (now->room[i] / size < a) a = now->room[i] / size;
    if (g->limits.jerk[i] / size < *jerk) *jerk = g->limits.jerk[i] / size;
  }
  *jerk *= AIM_BRAKING * AIM_JERK;
  a *= AIM_BRAKING;
  return peak_acceleration(1.0, *jerk) < a ? peak_acceleration(1.0, *jerk) : a;
}

/* Speed and acceleration along the joint displacement x, in shares of it. */
static void closing_speed(const Arm *arm, const Now *now, const double x[], double *speed, double *a) {
  double y[N], z[N], square = 0.0;
  *speed = *a = 0.0;
  joint_rates(arm, now->B, now->twist, y);
  joint_rates(arm, now->B, now->rate, z);
  for (int i = 0; i < N; i++) {
    square += x[i] * x[i];
    *speed += x[i] * y[i];
    *a += x[i] * z[i];
  }
  if (!(square >= TINY)) square = TINY;
  *speed /= square;
  *a /= square;
}

/* Way on which an acceleration a > 0 falls to 0; 0 for a deceleration. */
static double release_way(double speed, double a, double jerk) {
  const double t = a > 0.0 ? a / jerk : 0.0;
  return speed * t + a * t * t / 3.0;
}

/* Choose the derivative of the twist after the next stride, on the way to another twist. */
static void next_rate(const Arm *arm, const Governor *g, const Now *now, const double wish[], double later[]) {
  const double T = g->stride;
  double gap[RATES], change[RATES], x[N], fits = HUGE_VAL, jerk = HUGE_VAL, most = HUGE_VAL, share;
  for (int i = 0; i < RATES; i++) gap[i] = wish[i] - now->twist[i] - T / 2.0 * now->rate[i];
  joint_rates(arm, now->B, gap, x);
  for (int i = 0; i < N; i++) {
    const double size = fabs(x[i]) > TINY ? fabs(x[i]) : TINY;
    const double sign = x[i] > 0.0 ? 1.0 : x[i] < 0.0 ? -1.0 : 0.0;
    const double room = (AIM_ACCELERATION * g->limits.acceleration[i] - sign * now->bend[i]) / size;
    if (room < fits) fits = room;
    if (g->limits.jerk[i] / size < jerk) jerk = g->limits.jerk[i] / size;
  }
  share = approach_speed(1.0, AIM_JERK * jerk, T);
  if (!(fits > 0.0)) fits = 0.0;
  if (fits < share) share = fits;
  for (int i = 0; i < RATES; i++) change[i] = share * gap[i] - now->rate[i];
  joint_rates(arm, now->B, change, x);
  for (int i = 0; i < N; i++) {
    const double size = fabs(x[i]) > TINY ? fabs(x[i]) : TINY;
    if (AIM_JERK * g->limits.jerk[i] * T / size < most) most = AIM_JERK * g->limits.jerk[i] * T / size;
  }
  if (most > 1.0) most = 1.0;
  for (int i = 0; i < RATES; i++) later[i] = now->rate[i] + most * change[i];
}

/* Measure the samples of a plan: the largest shares of the limits that are used before and after a time, and whether
   the joints stay inside their limits. Speeds count as before: a longer stop does not lower them. */
static int shares_used(const Arm *arm, const Governor *g, const Plan *plan, double begin, double *before, double *after) {
  const double dt = g->dt;
  const long last = (long)ceil(plan->time / dt) + 3;
  double H[3][N], per_speed[N], per_acceleration[N], per_jerk[N];
  double speed = 0.0, first = 0.0, later = 0.0;
  int piece = 0;
  for (int i = 0; i < N; i++) {
    per_speed[i] = 1.0 / (g->limits.velocity[i] * dt);
    per_acceleration[i] = 1.0 / (g->limits.acceleration[i] * dt * dt);
    per_jerk[i] = 1.0 / (g->limits.jerk[i] * dt * dt * dt);
  }
  for (int k = 0; k < 3; k++)
    for (int i = 0; i < N; i++) H[k][i] = g->history[k][i];
  for (long k = 1; k <= last; k++) {
    const double t = (double)k * dt;
    double q[N], worst = 0.0;
    while (piece < plan->pieces && t > plan->piece[piece].end) piece++;
    if (piece < plan->pieces)
      piece_at(arm, &plan->piece[piece], t, q);
    else
      for (int i = 0; i < N; i++) q[i] = plan->q[i];
    for (int i = 0; i < N; i++) {
      const double d1 = q[i] - H[2][i], e1 = H[2][i] - H[1][i], d2 = d1 - e1;
      const double d3 = d2 - (e1 - (H[1][i] - H[0][i]));
      const double v = fabs(d1) * per_speed[i], a = fabs(d2) * per_acceleration[i];
      const double j = fabs(d3) * per_jerk[i];
      if (!(q[i] >= g->lower[i] - WITHIN && q[i] <= g->upper[i] + WITHIN)) return 0;
      if (!(v <= speed)) speed = v;
      if (!(a <= worst)) worst = a;
      if (!(j <= worst)) worst = j;
      H[0][i] = H[1][i];
      H[1][i] = H[2][i];
      H[2][i] = q[i];
    }
    if (plan->lands && !(speed <= 1.0 && worst <= 1.0)) return 0; /* a landing is not tried again */
    if (t > begin) {
      if (!(worst <= later)) later = worst;
    } else if (!(worst <= first))
      first = worst;
  }
  *before = speed > first ? speed : first;
  *after = later;
  return 1;
}

/* Tell whether an arm at rest at q can leave it: q is not, or not more than now, singular. */
static int can_leave(const Arm *arm, const double q[], const Now *now) {
  const double there = regularity(arm, q);
  return there > 0.0 && (there >= REGULAR || there >= regularity(arm, now->q));
}

static int plan_failure(const Governor *g) {
  if (g->left < 0) return SLOWED;
  return g->outside ? OUTSIDE : SINGULAR;
}

/* Append a motion, in pieces as long as the last ones could be. */
static int plan_append_long(const Arm *arm, Governor *g, Plan *plan, double travel) {
  const double parts = ceil(travel / g->reach);
  const int count = parts > 16.0 ? 16 : parts > 1.0 ? (int)parts : 1;
  const int made = plan_append(arm, g, plan, 1, count);
  if (made) {
    g->reach = travel / made > 1e-3 ? travel / made : 1e-3;
    if (made == count) g->reach = 0.15;
  } else if (g->left < 0)
    g->reach = 0.15; /* shorter pieces are more than a tick can evaluate */
  return made;
}

/* Count the samples of a plan as evaluations, as they take as long; return 0 if too few are left. */
static int affords(Governor *g, const Plan *plan) {
  const double count = plan->time / g->dt / SAMPLES_PER_EVALUATION;
  g->left -= count < MOST_SAMPLES ? (int)count : MOST_SAMPLES;
  return g->left >= 0;
}

/* Tell whether a plan is made in one tick, for the state in which the next one begins, and allowed there: so no tick does
   both. Ticks of several parts are long enough for both. */
static int in_two_ticks(const Governor *g) { return g->allows && g->parts == 1; }

/* Follow the plan that was made last. */
static void follow_plan(const Arm *arm, Governor *g) {
  g->taken = 1 - g->taken;
  g->tick = 0;
  if (g->plan[g->taken].lands) copy_goal(arm, &g->heard, &g->landing);
}

/* Take a plan within the limits, unless a function does not allow it; return OK, or the status of that function. If that
   is asked in the next tick, the plan is pending. */
static int plan_take(const Arm *arm, Governor *g) {
  int status;
  g->pending = in_two_ticks(g);
  if (g->pending) return OK;
  status = g->allows ? g->allows(g->guard, &g->plan[1 - g->taken]) : OK;
  if (status == OK) follow_plan(arm, g);
  return status;
}

/* Tell whether a plan was taken, or is pending. */
static int planned(const Governor *g) { return g->pending || !g->tick; }

/* Add a stop to a plan, as short as the limits allow; take the plan if it serves. */
static int try_stop(const Arm *arm, Governor *g, Plan *plan, const Now *now, const Course *course,
                           const double twist[], const double rate[]) {
  const int motions = plan->motions, pieces = plan->pieces;
  const double begin = plan->time;
  double x[N], q[N], qdot[N], fast = 0.0, shortest = 0.0, jerk = 0.0;
  joint_rates(arm, now->B, twist, x);
  for (int i = 0; i < N; i++) {
    const double size = fabs(x[i]), time = 1.5 * size / (AIM_ACCELERATION * now->room[i]);
    if (size > fast) fast = size;
    if (time > shortest) shortest = time;
    if (6.0 * size / (AIM_JERK * g->limits.jerk[i]) > jerk) jerk = 6.0 * size / (AIM_JERK * g->limits.jerk[i]);
    q[i] = plan->q[i];
    qdot[i] = plan->qdot[i];
  }
  if (sqrt(jerk) > shortest) shortest = sqrt(jerk);
  for (int k = 0; k < 2; k++) {
    double T = g->longer * shortest, before, after;
    if (T < 4.0 * g->dt) T = 4.0 * g->dt;
    plan->motions = motions;
    plan->pieces = pieces;
    plan->time = begin;
    for (int i = 0; i < N; i++) {
      plan->q[i] = q[i];
      plan->qdot[i] = qdot[i];
    }
    motion_brake(arm, &plan->motion[motions], course, twist, rate, T);
    if (!plan_append_long(arm, g, plan, fast * T / 2.0)) return plan_failure(g);
    if (!can_leave(arm, plan->q, now)) return SINGULAR;
    if (!affords(g, plan)) return SLOWED;
    if (!shares_used(arm, g, plan, begin, &before, &after)) return LIMIT;
    if (!(before <= 1.0)) return SLOWED;
    if (after <= 1.0) {
      g->longer = 0.98 * g->longer > 1.0 ? 0.98 * g->longer : 1.0;
      return plan_take(arm, g);
    }
    g->longer *= 1.05 * after < 1.6 ? 1.05 * after : 1.6;
    if (g->longer > 4.0) g->longer = 4.0;
  }
  return SLOWED;
}

/* Plan a stride, the end of its acceleration, and a stop; take the plan if it serves. */
static int try_stride(const Arm *arm, Governor *g, const Now *now, const double later[]) {
  Plan *plan = &g->plan[1 - g->taken];
  Motion *motion = plan->motion;
  Course course;
  double twist[RATES], rate[RATES], x[N], release = g->dt;
  int bounded = 1;
  plan_begin(arm, plan, &now->course, now->q, now->qdot);
  motion_change(arm, motion, &now->course, now->twist, now->rate, later, g->stride);
  if (!plan_append(arm, g, plan, 0, 1)) return plan_failure(g);
  motion_course_at(arm, motion, g->stride, &course);
  motion_rates(arm, motion, g->stride, twist, rate);
  joint_rates(arm, now->B, rate, x);
  for (int i = 0; i < N; i++) {
    if (!(g->limits.jerk[i] < HUGE_VAL)) bounded = 0;
    if (fabs(x[i]) / (AIM_JERK * g->limits.jerk[i]) > release) release = fabs(x[i]) / (AIM_JERK * g->limits.jerk[i]);
  }
  if (bounded) {
    static const double zero[6 * MOST_FRAMES + MOST_N] = {0.0};
    motion++;
    motion_change(arm, motion, &course, twist, rate, zero, release);
    if (!plan_append(arm, g, plan, release > 0.02, 1)) return plan_failure(g);
    motion_course_at(arm, motion, release, &course);
    motion_rates(arm, motion, release, twist, rate);
  } else
    for (int i = 0; i < RATES; i++) rate[i] = 0.0;
  return try_stop(arm, g, plan, now, &course, twist, rate);
}

/* Plan to come to rest at a displacement, if it is near; return 1 if the plan is taken. */
static int try_landing(const Arm *arm, Governor *g, const Now *now, const double way[], const double x[], double a,
                           double jerk, double speed, double closing, double rise) {
  static const double longer[2][3] = {{1.0, 1.15, 1.4}, {0.95, 1.0, 1.05}};
  Plan *plan = &g->plan[1 - g->taken];
  double travel = 0.0, T, before, after;
  int fast;
  for (int i = 0; i < N; i++)
    if (fabs(x[i]) > travel) travel = fabs(x[i]);
  fast = closing > 0.0 && closing * closing / (2.0 * a) >= 0.75;
  if (fast)
    T = 2.0 / closing;
  else {
    const double peak = sqrt(a + closing * closing / 2.0);
    if (peak > speed || travel > 0.03) return 0;
    T = (2.0 * peak - closing) / a;
  }
  T += 1.5 * a / jerk;
  g->turn = (g->turn + 1) % 3;
  T *= longer[fast][g->turn];
  if (longest_landing(closing, rise) < T) T = longest_landing(closing, rise);
  if (T < 3.0 * g->dt) T = 3.0 * g->dt;
  plan_begin(arm, plan, &now->course, now->q, now->qdot);
  plan->lands = 1;
  motion_land(arm, plan->motion, &now->course, now->twist, now->rate, way, T);
  if (!plan_append_long(arm, g, plan, travel) || !can_leave(arm, plan->q, now)) return 0;
  if (!affords(g, plan)) return 0;
  if (!shares_used(arm, g, plan, 0.0, &before, &after) || !(before <= 1.0) || !(after <= 1.0)) return 0;
  return plan_take(arm, g) == OK;
}

/* Tell whether joint speeds are negligible. */
static int is_slow(const Arm *arm, const Governor *g, const double x[]) {
  (void)arm;
  for (int i = 0; i < N; i++)
    if (!(fabs(x[i]) <= 1e-6 * g->limits.velocity[i])) return 0;
  return 1;
}

/* Tell whether the velocity is the one asked for. */
static int reached_status(const Arm *arm, const Governor *g, const Now *now, const double way[]) {
  double away[RATES], x[N];
  for (int i = 0; i < RATES; i++) away[i] = way[i] - now->twist[i];
  joint_rates(arm, now->B, away, x);
  return is_slow(arm, g, x) ? OK : SLOWED;
}

/* Tell whether the plan has ended, and all differences are 0. */
static int rests(const Governor *g) { return (double)(g->tick - 3) * g->dt >= g->plan[g->taken].time; }

/* Lower the pace, as no plan was found, for a cause. */
static void slow_down(Governor *g, int cause) {
  g->pace = 0.7 * g->pace > 1e-3 ? 0.7 * g->pace : 1e-3;
  g->cause = cause;
}

/* Go on in a direction for a stride, as fast as the limits allow. */
static int drive(const Arm *arm, Governor *g, const Now *now, const double way[], double asked, int lands) {
  double by_speed, by_room, speed, wish[RATES], later[RATES];
  int cause, i = 0;
  while (i < RATES && way[i] == 0.0) i++;
  if (i == RATES) return reached_status(arm, g, now, way);
  fastest_along(arm, g, now, way, &by_speed, &by_room);
  speed = (by_speed < by_room ? by_speed : by_room) * g->pace;
  if (asked < speed) speed = asked;
  for (i = 0; i < RATES; i++) wish[i] = way[i] * speed;
  next_rate(arm, g, now, wish, later);
  cause = try_stride(arm, g, now, later);
  if (cause == SLOWED) {
    for (i = 0; i < RATES; i++) later[i] = (now->later[i] + later[i]) / 2.0;
    try_stride(arm, g, now, later);
    if (!planned(g) && rests(g)) slow_down(g, SLOWED);
    return cause;
  }
  if (cause != OK) {
    slow_down(g, cause);
    return cause;
  }
  g->pace = 1.1 * g->pace < 1.0 ? 1.1 * g->pace : 1.0;
  if (g->pace < 1.0) return g->cause;
  if (by_room < by_speed && by_room < asked) return LIMIT;
  return lands ? SLOWED : reached_status(arm, g, now, way);
}

/* Direct the frames so that the joints approach those of the goal, along the leaf, and the levels straight. */
static void way_of_joints(const Arm *arm, Governor *g, const Now *now, double way[], double x[]) {
  double p[3 * FRAMES], R[9 * FRAMES], J[M][N], rate[M], d[N], size = 0.0, miss = 0.0;
  for (int i = 0; i < N; i++) {
    const double apart = g->line.q[i] - now->q[i];
    if (!(fabs(apart) <= size)) size = fabs(apart);
    if (!(fabs(apart - x[i]) <= miss)) miss = fabs(apart - x[i]);
  }
  if (size < 0.3 && miss < 0.1 * size) {
    g->by_joints = 0;
    return;
  }
  leaf_direction(arm, now->q, g->line.q, d);
  place(arm, now->q, p, R, J);
  for (int a = 0; a < M; a++) {
    rate[a] = 0.0;
    for (int i = 0; i < N; i++) rate[a] += J[a][i] * d[i];
  }
  course_rates_of(arm, &now->course, rate, way);
  for (int k = 0; k < N - M; k++) way[TWISTS + k] = g->line.goal.leaf[k] - now->course.leaf[k];
  joint_rates(arm, now->B, way, x);
}

/* Take the way of the joints, as the straight line is blocked; return 1 while they are looked for. At the edge of a
   cell, come to rest and begin again: from rest, the straight line does not leave the cell. */
static int other_way(const Arm *arm, Governor *g, const Goal *goal, int rests) {
  if (has_bounds(arm) && g->status == OUTSIDE) {
    if (!rests) return 1;
    g->stuck = g->by_joints = 0;
    g->pace = 1.0;
    return 0;
  }
  look_for(arm, g, goal);
  if (!g->line.known) return 1;
  g->by_joints |= g->line.found;
  g->stuck = 0;
  return 0;
}

/* Count the plans without progress; refused is their number if the pending one is not allowed. */
static void count_stuck(const Arm *arm, Governor *g, const Now *now, int status) {
  int slow = 1;
  (void)arm;
  for (int i = 0; i < N; i++)
    if (!(fabs(now->qdot[i]) < 0.02 * g->limits.velocity[i])) slow = 0;
  g->refused = slow ? g->stuck + 1 : 0;
  g->stuck = status != OK && (status != SLOWED || !planned(g)) ? g->refused : 0;
}

/* Move towards a goal for a stride, or come to rest there. */
static int to_goal(const Arm *arm, Governor *g, const Now *now, const Goal *goal) {
  const Plan *plan = &g->plan[g->taken];
  const int still = rests(g);
  const int lands = plan->lands && equal_goals(arm, goal, &g->landing);
  double way[RATES], x[N], travel = 0.0, a, jerk, speed, rise, left, by_speed, by_room;
  int status;
  if (lands) look_for(arm, g, goal); /* only in ticks without a plan */
  if (lands && !still) return SLOWED;
  if (g->stuck > 25 && other_way(arm, g, goal, still)) return g->status;
  course_way(arm, &now->course, goal, way);
  joint_rates(arm, now->B, way, x);
  for (int i = 0; i < N; i++)
    if (!(fabs(x[i]) <= travel)) travel = fabs(x[i]);
  if (lands || (still && travel < 1e-10)) {
    if (!lands) look_for(arm, g, goal);
    if (is_there(arm, g, now->q)) return course_holds(arm, goal) ? OK : OUTSIDE;
    if (!g->by_joints) return SLOWED;
  }
  if (g->by_joints) way_of_joints(arm, g, now, way, x);
  a = braking_rate(arm, g, now, x, &jerk);
  closing_speed(arm, now, x, &speed, &rise);
  fastest_along(arm, g, now, way, &by_speed, &by_room);
  if (!g->by_joints && !g->exhausted && try_landing(arm, g, now, way, x, a, jerk, by_speed, speed, rise)) {
    g->pace = 1.0;
    return SLOWED;
  }
  g->exhausted = g->left < 0; /* by the landing: the next tick is for a stride */
  left = 1.0 - release_way(speed, rise, jerk);
  status = drive(arm, g, now, way, arrival_speed(left, a, jerk, 2.0 * g->stride), 1);
  count_stuck(arm, g, now, status);
  return status;
}

/* Choose the rates of the levels towards those asked for, way[TWISTS], ...: as fast as they can still stop there. */
static void level_rates(const Arm *arm, const Governor *g, const Now *now, const double leaf[], double way[]) {
  double only[RATES], x[N], square = 0.0, speed = 0.0, rise = 0.0, travel = 0.0, a, jerk, by_speed, by_room, fits;
  for (int i = 0; i < TWISTS; i++) only[i] = 0.0;
  for (int k = TWISTS; k < RATES; k++) {
    only[k] = leaf[k - TWISTS] - now->course.leaf[k - TWISTS];
    square += only[k] * only[k];
    speed += only[k] * now->twist[k];
    rise += only[k] * now->rate[k];
  }
  joint_rates(arm, now->B, only, x);
  for (int i = 0; i < N; i++)
    if (!(fabs(x[i]) <= travel)) travel = fabs(x[i]);
  if (!(travel > 1e-12 && square > TINY)) return;
  a = braking_rate(arm, g, now, x, &jerk);
  fastest_along(arm, g, now, only, &by_speed, &by_room);
  fits = arrival_speed(1.0 - release_way(speed / square, rise / square, jerk), a, jerk, 2.0 * g->stride);
  if (by_speed < fits) fits = by_speed;
  if (by_room < fits) fits = by_room;
  for (int k = TWISTS; k < RATES; k++) way[k] = fits * only[k];
}

/* Move by twists of the frames, and to levels, for a stride. */
static int follow(const Arm *arm, Governor *g, const Now *now, const Input *input) {
  double rate[M], left_out[M], way[RATES], E[M * TWISTS], x[N];
  int status;
  for (int a = 0; a < M; a++) rate[a] = 0.0;
  if (input->twist) course_rates(arm, &now->course, input->twist, rate);
  course_rates_of(arm, &now->course, rate, way);
  if (input->to_leaf) level_rates(arm, g, now, input->goal.leaf, way);
  status = drive(arm, g, now, way, 1.0, 0);
  course_task_rates(arm, &now->course, E);
  for (int a = 0; a < M; a++) {
    left_out[a] = rate[a];
    for (int b = 0; b < TWISTS; b++) left_out[a] -= E[a * TWISTS + b] * way[b];
  }
  for (int i = 0; i < N; i++) {
    x[i] = 0.0;
    for (int a = 0; a < M; a++) x[i] += now->G[i * N + a] * left_out[a];
  }
  return status == OK && !is_slow(arm, g, x) ? OUTSIDE : status; /* along a coordinate of width 0 */
}

static int is_small(const double *x, int count) {
  for (int i = 0; i < count; i++)
    if (!(fabs(x[i]) < FAR)) return 0;
  return 1;
}

/* Tell whether the last plan heeds an input, or whether it is newer. */
static int is_heeded(const Arm *arm, const Governor *g, const Input *input) {
  const double *twist = input->twist;
  if (input->to_pose) return g->heeds_target && equal_goals(arm, &input->goal, &g->heard);
  if (g->heeds_target || g->heeds_leaf != input->to_leaf) return 0;
  for (int i = 0; i < TWISTS; i++)
    if ((twist ? twist[i] : 0.0) != g->heard_twist[i]) return 0;
  for (int k = 0; k < N - M && input->to_leaf; k++)
    if (input->goal.leaf[k] != g->heard.leaf[k]) return 0;
  return 1;
}

/* Begin at rest at q, if the arguments are right. Beyond a joint limit, the leaf is that of the configuration inside. */
static int start_at_rest(const Arm *arm, Governor *g, const double q[], double dt, const Limits *limits) {
  double G[N * M], still[N], inside[N];
  g->recovers = 0;
  if (!all_finite(q, N) || !(dt >= SHORTEST && dt <= LONGEST)) return BAD_NUMBER;
  if (!(limits->margin >= 0.0 && limits->margin < HUGE_VAL)) return BAD_NUMBER;
  for (int i = 0; i < N; i++) {
    if (!(limits->velocity[i] > 0.0 && limits->velocity[i] < HUGE_VAL)) return BAD_NUMBER;
    if (!(limits->acceleration[i] > 0.0 && limits->acceleration[i] < HUGE_VAL)) return BAD_NUMBER;
    if (!(limits->jerk[i] > 0.0)) return BAD_NUMBER;
    if (!(q[i] >= arm->lower[i] - BEYOND && q[i] <= arm->upper[i] + BEYOND)) return LIMIT;
    g->lower[i] = arm->lower[i] + limits->margin + WITHIN * 1.01;
    g->upper[i] = arm->upper[i] - limits->margin - WITHIN * 1.01;
    if (!(g->lower[i] <= g->upper[i])) return LIMIT;
    inside[i] = q[i] < g->lower[i] ? g->lower[i] : q[i] > g->upper[i] ? g->upper[i] : q[i];
    if (inside[i] != q[i]) g->recovers = 1;
  }
  if (find_inside(arm, inside) != OK) return OUTSIDE;
  if (find_inverse(arm, inside, G) != OK || find_leaf(arm, inside, g->leaf) != OK) return SINGULAR;
  for (int k = 0; k < N - M; k++) g->line.course.leaf[k] = g->leaf[k];
  g->limits = *limits;
  g->parts = dt > PART ? (int)ceil(dt / PART * (1.0 - 1e-9)) : 1;
  g->dt = dt / g->parts;
  g->ticks = (long long)(STRIDE / g->dt + 0.5);
  g->stride = (double)g->ticks * g->dt;
  for (int i = 0; i < N; i++) {
    g->line.start[i] = inside[i];
    still[i] = 0.0;
    for (int k = 0; k < 3; k++) g->history[k][i] = q[i];
  }
  course_begin(arm, inside, &g->line.course);
  for (int f = 0; f < FRAMES; f++)
    if (!is_small(g->line.course.place[f].p, 3)) return BAD_NUMBER;
  plan_begin(arm, &g->plan[0], &g->line.course, q, still);
  plan_begin(arm, &g->plan[1], &g->line.course, inside, still);
  if (g->recovers) plan_back(arm, g, q, inside, &g->plan[1]);
  g->idle = g->taken = g->turn = g->pending = g->heeds_target = g->heeds_leaf = g->holds = g->stuck = g->by_joints = g->exhausted = g->line.begun = 0;
  for (int i = 0; i < TWISTS; i++) g->heard_twist[i] = 0.0;
  g->tick = 3; /* all differences are 0 */
  g->next = 0;
  g->pace = g->longer = 1.0;
  g->reach = 0.15;
  g->status = g->cause = OK;
  g->allows = NULL;
  g->guard = NULL;
  return OK;
}

/* Begin at rest at q. */
SHARED int govern_from(const Arm *arm, Governor *g, const double q[], double dt, const Limits *limits) {
  g->status = start_at_rest(arm, g, q, dt, limits);
  g->started = g->status == OK;
  return g->status;
}

/* Begin to come back from beyond a joint limit, with the first input. */
static void recover(Governor *g) {
  g->recovers = 0;
  g->taken = 1;
  g->tick = 0;
  g->next = (long long)ceil(g->plan[1].time / g->dt) + 3; /* at rest inside: all differences are 0 */
  g->status = RECOVERING;
}

/* Tell whether it is time to plan. */
static int is_due(const Governor *g) { return !g->recovers && g->tick >= g->next; }

/* Plan for the present state. */
static void make_plan(const Arm *arm, Governor *g, const Input *input) {
  const int heeded = is_heeded(arm, g, input);
  double G[N * N], B[2 * N * RATES];
  int status = SINGULAR;
  Now now;
  now.G = G, now.B = B, now.B_ahead = B + N * RATES;
  g->left = MOST_EVALUATIONS;
  g->asked = 0;
  g->paced = g->pace;
  if (!input->to_pose || !g->heeds_target || !equal_goals(arm, &input->goal, &g->heard)) g->stuck = g->by_joints = 0;
  g->heeds_target = input->to_pose;
  g->heeds_leaf = input->to_leaf;
  if (input->to_pose) copy_goal(arm, &input->goal, &g->heard);
  for (int k = 0; k < N - M; k++) g->heard.leaf[k] = input->goal.leaf[k];
  for (int i = 0; i < TWISTS; i++) g->heard_twist[i] = input->twist ? input->twist[i] : 0.0;
  if (state_now(arm, g, &now))
    status = input->to_pose ? to_goal(arm, g, &now, &input->goal) : follow(arm, g, &now, input);
  g->idle = status == SLOWED && !planned(g) && rests(g) ? g->idle + 1 : 0;
  if (g->idle > MOST_IDLE) status = SINGULAR;
  g->next = g->tick + g->ticks;
  g->proposed = status;
  if (!g->pending) g->status = status;
  if (g->pending && g->status == OK && !heeded) g->status = SLOWED;
}

/* Ask whether the pending plan is allowed, and follow it; else be as if it had not been made. After a landing that is
   not allowed, a stride is planned, but not in this tick. */
static void settle(const Arm *arm, Governor *g) {
  const int lands = g->plan[1 - g->taken].lands;
  int status;
  g->pending = g->part = g->asked = 0;
  status = g->allows(g->guard, &g->plan[1 - g->taken]);
  if (status == OK) {
    follow_plan(arm, g);
    g->next = g->ticks;
    g->status = g->proposed;
    return;
  }
  g->pace = g->paced;
  if (lands) {
    g->exhausted = 1;
    g->next = g->tick + 2;
    return;
  }
  slow_down(g, status);
  g->stuck = g->refused;
  g->status = status;
}

/* Move on by one part of a tick. */
static void advance(const Arm *arm, Governor *g) {
  g->tick++;
  for (int i = 0; i < N; i++) {
    g->history[0][i] = g->history[1][i];
    g->history[1][i] = g->history[2][i];
  }
  plan_at(arm, &g->plan[g->taken], (double)g->tick * g->dt, g->history[2]);
}

/* Complete an input by the known stop: with levels alone, the pose there is held; without levels and a pose, the levels
   come to rest there. Else levels that are not given are the last ones. */
static void complete(const Arm *arm, Governor *g, const double *leaf, Input *input) {
  const int alone = leaf && !input->to_pose && !input->twist, rests = !leaf && !input->to_pose;
  Course course;
  if (rests || (alone && !g->holds)) plan_course_at(arm, &g->plan[g->taken], g->plan[g->taken].time, &course);
  if (rests) leaf = course.leaf;
  for (int f = 0; f < FRAMES && alone; f++) {
    if (!g->holds) g->held[f] = course.place[f];
    input->goal.place[f] = g->held[f];
  }
  input->to_pose |= alone;
  g->holds = alone;
  for (int k = 0; k < N - M; k++) {
    if (leaf) g->leaf[k] = leaf[k];
    input->goal.leaf[k] = g->leaf[k];
  }
}

/* Compute the next joints to command, towards a target or by a twist, and to levels; without all it stops. A tick is divided into
   equal parts: limits that are kept by the differences of the parts are kept by those of the ticks, which are their
   weighted means. */
SHARED int govern(const Arm *arm, Governor *g, const Pose *target, const double *twist, const double *leaf,
                  double q_next[]) {
  Input input;
  int accepted = !(target && twist), moves = target || twist || leaf, settles;
  if (!g->started) return g->status == OK ? BAD_NUMBER : g->status;
  if (target && !usable(arm, target)) accepted = 0;
  for (int f = 0; f < FRAMES && target; f++) accepted &= is_small(target[f].p, 3);
  if (twist && !is_small(twist, TWISTS)) accepted = 0;
  if (leaf && !is_small(leaf, N - M)) accepted = 0;
  input.twist = twist;
  input.to_pose = target != NULL;
  input.to_leaf = leaf != NULL;
  for (int f = 0; f < FRAMES && target; f++) input.goal.place[f] = target[f];
  settles = g->pending;
  if (settles) settle(arm, g);
  if (accepted) complete(arm, g, leaf, &input);
  if (g->recovers && accepted && moves) recover(g);
  for (g->part = 0; g->part < g->parts; g->part++) {
    if (accepted && is_due(g) && !in_two_ticks(g)) make_plan(arm, g, &input);
    advance(arm, g);
  }
  if (accepted && is_due(g) && in_two_ticks(g) && !settles) make_plan(arm, g, &input);
  for (int i = 0; i < N; i++) q_next[i] = g->history[2][i];
  if (!accepted) return BAD_NUMBER;
  if (g->status == OK && !is_heeded(arm, g, &input)) return SLOWED;
  return g->status;
}
