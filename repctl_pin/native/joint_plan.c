/* Plans: motions of the frames and levels, and polynomials of the joints that follow them. */

#include <math.h>
#include <stddef.h>

#include "governor.h"
#include "law.h"

/* Shares of the speed limits, and of those of acceleration and jerk, on the way back from beyond a joint limit. */
#define BACK_SPEED 0.1
#define BACK 0.5

/* Chebyshev-Lobatto nodes from 0 to 1, of two degrees; extrapolation to node j from the nodes before j, and, column j,
   from the derivative at node 0; coefficients of 1, u, u^2, ... from values at the nodes. */
static const double NODE_SHARE[2][DEGREE + 1] = {
  {0, 0.1464466094067262, 0.49999999999999994, 0.8535533905932737, 1.0},
  {0, 0.024471741852423234, 0.09549150281252627, 0.20610737385376343, 0.3454915028125263, 0.49999999999999994,
   0.6545084971874737, 0.7938926261462365, 0.9045084971874737, 0.9755282581475768, 1.0}};
static const double NODE_AHEAD[2][DEGREE + 1][DEGREE + 1] = {{
  {0},
  {1.0, 0.1464466094067262},
  {-10.656854249492381, 11.656854249492381, -1.2071067811865475},
  {29.14213562373098, -33.97056274847717, 5.8284271247461925, 2.914213562373098},
  {-11.000000000000044, 13.656854249492431, -4.000000000000007, 2.3431457505076208, -1.0000000000000044}}, {
  {0},
  {1.0, 0.024471741852423234},
  {-14.226486119111092, 15.226486119111092, -0.2771271348138661},
  {99.5684191200097, -110.48301855917423, 11.914599439164537, 1.7720762772552558},
  {-474.08203691566064, 538.4161202676346, -74.55791036595251, 11.223827013978564, -8.0241554045939},
  {1603.122807146925, -1851.6842288137575, 301.4333373127886, -62.4564762721021, 10.584560626146125,
   26.24548060920567},
  {-3713.8032676633475, 4347.493042860002, -797.6348583821951, 206.0386238626359, -50.66736570244041,
   9.573825025345155, -59.316715499671915},
  {5402.125807544195, -6396.3446075058155, 1292.8737689460797, -396.8139060903285, 127.91414173217078,
   -36.87684215038581, 8.12163752408472, 84.5808908561241},
  {-4226.922556554344, 5056.500024362219, -1111.7763996273743, 395.27643616123265, -159.18880461138355,
   63.42274672183369, -22.60073510670048, 6.289288654517082, -65.05468452863315},
  {1315.4941202399025, -1589.0952987920853, 377.5920956034445, -153.54766264429392, 75.51841912067205,
   -39.86345818907099, 21.042486287386346, -10.349198883431894, 4.2084972574767505, 19.93172909454445},
  {-67.00000000240375, 81.72691638101753, -20.94427191067041, 9.703679992900152, -5.788854382121289,
   4.000000000059812, -3.0557280900302186, 2.519232367378518, -2.2111456180053772, 2.050171261875029,
   -1.0000000000366012}}};
static const double NODE_MONOMIALS[2][DEGREE + 1][DEGREE + 1] = {{
  {1.1102230246251565e-16, 0, 1.0, 2.220446049250313e-16, -5.551115123125783e-17},
  {0.49999999999999967, -1.4142135623730945, -4.710277376051324e-16, 1.4142135623730951, -0.4999999999999998},
  {-0.5000000000000003, 2.0000000000000004, -3.0, 1.9999999999999993, -0.4999999999999997},
  {-0.9999999999999997, 1.4142135623730945, 4.710277376051324e-16, -1.4142135623730951, 0.9999999999999998},
  {1.0000000000000002, -2.0000000000000004, 2.0, -1.9999999999999996, 0.9999999999999998}}, {
  {-4.440892098500626e-15, 1.7763568394002505e-15, -9.325873406851315e-15, 9.769962616701378e-15,
   -1.2434497875801753e-14, 1.0000000000000102, -1.2434497875801753e-14, -9.769962616701378e-15,
   2.353672812205332e-14, -1.5987211554602254e-14, 4.440892098500626e-15},
  {-0.49999999999998757, 1.0514622242382607, -1.2360679774997685, 1.701301616704086, -3.2360679774997827,
   -3.24348665741192e-14, 3.236067977499779, -1.7013016167040824, 1.2360679774998076, -1.0514622242382679,
   0.5000000000000009},
  {0.49999999999998934, -1.1055728090000603, 1.52786404500038, -2.8944271909998234, 10.472135954999496,
   -16.999999999999844, 10.472135954999464, -2.894427190999811, 1.52786404500034, -1.1055728089999857,
   0.4999999999999636},
  {7.999999999999831, -16.712389767241685, 19.124611797497845, -23.997833824488822, 21.12461179749797,
   9.980612375120987e-14, -21.12461179749809, 23.997833824488918, -19.124611797498055, 16.712389767241863,
   -7.999999999999958},
  {-7.9999999999999, 17.57244651700082, -23.639320225001725, 40.827553482998304, -68.36067977499725, 83.1999999999991,
   -68.36067977499698, 40.82755348299813, -23.63932022500142, 17.572446517000436, -7.999999999999698},
  {-33.59999999999964, 69.00489335654922, -73.62104898799379, 72.08831176308087, -48.02104898799413,
   -2.0685632610968403e-14, 48.02104898799422, -72.08831176308098, 73.62104898799402, -69.00489335654957,
   33.599999999999895},
  {33.59999999999949, -72.55603865200119, 91.00062112400161, -122.64396134799588, 155.39937887599507,
   -169.59999999999783, 155.39937887599484, -122.64396134799584, 91.00062112400143, -72.55603865200092,
   33.59999999999935},
  {51.19999999999976, -102.03805944785762, 97.15417527999307, -79.8863844726709, 45.95417527999345,
   -2.3590018827235273e-13, -45.954175279993095, 79.88638447267068, -97.15417527999296, 102.03805944785775,
   -51.199999999999925},
  {-51.19999999999909, 107.28916494399941, -120.08916494399915, 135.91083505599627, -148.71083505599628,
   153.59999999999766, -148.7108350559966, 135.91083505599704, -120.08916494399998, 107.28916494400019,
   -51.19999999999951},
  {-25.599999999999966, 48.69409363431183, -41.42167011199736, 30.09460491737477, -15.82167011199751,
   1.8921456370623047e-13, 15.821670111997186, -30.09460491737454, 41.42167011199719, -48.69409363431177,
   25.599999999999987},
  {25.59999999999952, -51.19999999999899, 51.199999999998894, -51.19999999999887, 51.199999999998965,
   -51.19999999999908, 51.19999999999928, -51.19999999999951, 51.19999999999962, -51.19999999999971,
   25.599999999999895}}};
static const int NODE_DEGREE[2] = {4, DEGREE};

SHARED void piece_at(const Arm *arm, const Piece *piece, double t, double q[]) {
  const double u = (2.0 * t - (piece->begin + piece->end)) / (piece->end - piece->begin);
  (void)arm;
  for (int i = 0; i < N; i++) q[i] = piece->C[piece->degree][i];
  for (int k = piece->degree - 1; k >= 0; k--)
    for (int i = 0; i < N; i++) q[i] = q[i] * u + piece->C[k][i];
}

SHARED void piece_derivatives(const Arm *arm, const Piece *piece, double t, double qdot[], double qddot[]) {
  const double scale = 2.0 / (piece->end - piece->begin);
  const double u = (2.0 * t - (piece->begin + piece->end)) / (piece->end - piece->begin);
  const int d = piece->degree;
  (void)arm;
  for (int i = 0; i < N; i++) {
    double first = d * piece->C[d][i], second = d * (d - 1) * piece->C[d][i];
    for (int k = d - 1; k > 0; k--) {
      first = first * u + k * piece->C[k][i];
      if (k > 1) second = second * u + k * (k - 1) * piece->C[k][i];
    }
    qdot[i] = first * scale;
    qddot[i] = second * scale * scale;
  }
}

/* Find the piece of a plan at a time; NULL after its end. */
SHARED const Piece *piece_of(const Plan *plan, double t) {
  for (int k = 0; k < plan->pieces; k++)
    if (t <= plan->piece[k].end) return &plan->piece[k];
  return NULL;
}

SHARED void plan_at(const Arm *arm, const Plan *plan, double t, double q[]) {
  const Piece *piece = piece_of(plan, t);
  if (piece)
    piece_at(arm, piece, t, q);
  else
    for (int i = 0; i < N; i++) q[i] = plan->q[i];
}

SHARED void plan_rates(const Arm *arm, const Plan *plan, double t, double twist[], double rate[]) {
  for (int k = 0; k < plan->motions; k++) {
    const Motion *motion = &plan->motion[k];
    if (t <= motion->begin + motion->duration) {
      motion_rates(arm, motion, t - motion->begin, twist, rate);
      return;
    }
  }
  for (int i = 0; i < RATES; i++) twist[i] = rate[i] = 0.0;
}

SHARED void plan_course_at(const Arm *arm, const Plan *plan, double t, Course *course) {
  if (!plan->motions) *course = plan->start;
  for (int k = 0; k < plan->motions; k++) {
    const Motion *motion = &plan->motion[k];
    const double end = motion->begin + motion->duration;
    motion_course_at(arm, motion, (t < end ? t : end) - motion->begin, course);
    if (t <= end) return;
  }
}

SHARED void plan_begin(const Arm *arm, Plan *plan, const Course *start, const double q[], const double qdot[]) {
  (void)arm;
  plan->start = *start;
  plan->motions = plan->pieces = plan->lands = 0;
  plan->time = 0.0;
  for (int i = 0; i < N; i++) {
    plan->q[i] = q[i];
    plan->qdot[i] = qdot[i];
  }
}

/* Solve f(q) = x, h(q) = c near q; return 0 without a solution inside the region. */
static int solved_near(const Arm *arm, Governor *g, const Course *at, double q[]) {
  g->outside = 0;
  for (int k = 0; k < 6; k++) {
    double x[N], size = 0.0;
    if (--g->left < 0) return 0;
    if (take_step(arm, q, at->place, 1.0, NULL, at->leaf, NULL, NULL, x) != OK) return 0;
    for (int i = 0; i < N; i++) {
      if (!(fabs(x[i] - q[i]) <= size)) size = fabs(x[i] - q[i]);
      q[i] = x[i];
    }
    if (!(size < 0.3)) return 0;
    if (size < 1e-6) {
      g->outside = find_inside(arm, q) != OK;
      return !g->outside;
    }
  }
  return 0;
}

/* Interpolate a motion between two times; return 0 if it fails. */
static int plan_interpolate(const Arm *arm, Governor *g, const Motion *motion, double begin, double end, const Plan *plan,
                           int table, Piece *piece, double last[]) {
  double Q[DEGREE + 1][N];
  piece->degree = NODE_DEGREE[table];
  for (int i = 0; i < N; i++) Q[0][i] = plan->q[i];
  for (int j = 1; j <= piece->degree; j++) {
    Course target;
    for (int i = 0; i < N; i++) {
      double guess = 0.0;
      for (int k = 0; k < j; k++) guess += NODE_AHEAD[table][j][k] * Q[k][i];
      Q[j][i] = guess + NODE_AHEAD[table][j][j] * ((end - begin) * plan->qdot[i]);
    }
    motion_course_at(arm, motion, begin + NODE_SHARE[table][j] * (end - begin), &target);
    if (!solved_near(arm, g, &target, Q[j])) return 0;
  }
  for (int i = 0; i < N; i++) last[i] = Q[piece->degree][i];
  for (int k = 0; k <= piece->degree; k++)
    for (int i = 0; i < N; i++) {
      double c = 0.0;
      for (int j = 0; j <= piece->degree; j++) c += NODE_MONOMIALS[table][k][j] * Q[j][i];
      piece->C[k][i] = c;
    }
  return 1;
}

/* Append motion[motions] to a plan, in count pieces or more; return their number, 0 if it fails. */
SHARED int plan_append(const Arm *arm, Governor *g, Plan *plan, int table, int count) {
  Motion *motion = &plan->motion[plan->motions];
  const double begin = plan->time, T = motion->duration;
  double done = 0.0, width = T / count;
  int made = 0;
  while (done < T) {
    const double end = T - done < 1.3 * width ? T : done + width;
    Piece *piece;
    double last[N], size = 0.0, spare[N];
    if (plan->pieces == PIECES) return 0;
    piece = &plan->piece[plan->pieces];
    if (!plan_interpolate(arm, g, motion, done, end, plan, table, piece, last)) return 0;
    for (int i = 0; i < N; i++)
      if (!(fabs(piece->C[piece->degree][i]) <= size)) size = fabs(piece->C[piece->degree][i]);
    if (!(ldexp(size, 1 - piece->degree) <= 3e-11)) {
      width = (end - done) / 2.0;
      if (width < T / 64.0) return 0;
      continue;
    }
    piece->begin = begin + done;
    piece->end = begin + end;
    piece_derivatives(arm, piece, begin + end, plan->qdot, spare);
    for (int i = 0; i < N; i++) plan->q[i] = last[i];
    plan->pieces++;
    done = end;
    made++;
  }
  motion->begin = begin;
  plan->motions++;
  plan->time = begin + T;
  return made;
}

/* Make the plan that brings the joints from q, beyond a limit, to those inside: each one on a quintic from rest to rest,
   so never farther out. */
SHARED void plan_back(const Arm *arm, const Governor *g, const double q[], const double inside[], Plan *plan) {
  static const double QUINTIC[6] = {0.5, 0.9375, 0.0, -0.625, 0.0, 0.1875}; /* from 0 to 1, by u */
  static const double PEAK[3] = {1.875, 5.7735026918962582, 60.0}; /* of its derivatives by time, for T = 1 */
  Piece *piece = &plan->piece[0];
  double T = 4.0 * g->dt;
  (void)arm;
  for (int i = 0; i < N; i++) {
    const double way = fabs(inside[i] - q[i]);
    const double by_speed = PEAK[0] * way / (BACK_SPEED * g->limits.velocity[i]);
    const double by_acceleration = sqrt(PEAK[1] * way / (BACK * g->limits.acceleration[i]));
    const double by_jerk = cbrt(PEAK[2] * way / (BACK * g->limits.jerk[i]));
    if (by_speed > T) T = by_speed;
    if (by_acceleration > T) T = by_acceleration;
    if (by_jerk > T) T = by_jerk;
  }
  piece->begin = 0.0;
  piece->end = plan->time = T;
  piece->degree = 5;
  for (int k = 0; k <= 5; k++)
    for (int i = 0; i < N; i++) piece->C[k][i] = (k ? 0.0 : q[i]) + QUINTIC[k] * (inside[i] - q[i]);
  plan->pieces = 1;
}
