
/* ---- governor: motions of the frame ------------------------------------------------------------------------ */

static void arm_cross(const double x[3], const double y[3], double z[3])
{
    z[0] = x[1] * y[2] - x[2] * y[1];
    z[1] = x[2] * y[0] - x[0] * y[2];
    z[2] = x[0] * y[1] - x[1] * y[0];
}

static void arm_displacement(const arm_motion *motion, double t, double phi[6])
{
    int i;
    for (i = 0; i < 6; i++)
        phi[i] = ((((motion->C[5][i] * t + motion->C[4][i]) * t + motion->C[3][i]) * t + motion->C[2][i]) * t
                  + motion->C[1][i]) * t;
}

/* R <- exp(w) R0. */
static void arm_turned(const double w[3], const double R0[9], double R[9])
{
    const double s = w[0] * w[0] + w[1] * w[1] + w[2] * w[2], angle = sqrt(s);
    const double a = s < 1e-4 ? 1.0 - s / 6.0 + s * s / 120.0 : sin(angle) / angle;
    const double b = s < 1e-4 ? 0.5 - s / 24.0 + s * s / 720.0 : (1.0 - cos(angle)) / s;
    double E[9];
    int i, k;
    for (i = 0; i < 3; i++)
        for (k = 0; k < 3; k++) E[3 * i + k] = b * w[i] * w[k] + (i == k ? 1.0 - b * s : 0.0);
    E[1] -= a * w[2];
    E[2] += a * w[1];
    E[3] += a * w[2];
    E[5] -= a * w[0];
    E[6] -= a * w[1];
    E[7] += a * w[0];
    for (i = 0; i < 3; i++)
        for (k = 0; k < 3; k++)
            R[3 * i + k] = E[3 * i] * R0[k] + E[3 * i + 1] * R0[3 + k] + E[3 * i + 2] * R0[6 + k];
}

/* Convert a rotation vector and its two derivatives to the angular velocity and its derivative. */
static void arm_angular(const double w[3], const double w1[3], const double w2[3], double omega[3], double alpha[3])
{
    const double s = w[0] * w[0] + w[1] * w[1] + w[2] * w[2];
    const double rate = 2.0 * (w[0] * w1[0] + w[1] * w1[1] + w[2] * w1[2]);
    double a, b, da, db, c1[3], c2[3], cc1[3], cc2[3], d[3];
    int i;
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
    arm_cross(w, w1, c1);
    arm_cross(w, w2, c2);
    arm_cross(w, c1, cc1);
    arm_cross(w, c2, cc2);
    arm_cross(w1, c1, d);
    for (i = 0; i < 3; i++) {
        omega[i] = w1[i] + a * c1[i] + b * cc1[i];
        alpha[i] = w2[i] + a * c2[i] + b * (d[i] + cc2[i]) + rate * (da * c1[i] + db * cc1[i]);
    }
}

@course
static void arm_moved(const arm_motion *motion, double t, arm_course *course)
{
    double phi[6];
    arm_displacement(motion, t, phi);
    arm_shifted(&motion->start, phi, course);
}

/* Evaluate the velocity of a motion in the coordinates of its course, and its derivative. */
static void arm_rates(const arm_motion *motion, double t, double twist[6], double rate[6])
{
    double phi[6], first[6], second[6];
    int i;
    arm_displacement(motion, t, phi);
    for (i = 0; i < 6; i++) {
        const double c2 = motion->C[2][i], c3 = motion->C[3][i], c4 = motion->C[4][i], c5 = motion->C[5][i];
        first[i] = (((5.0 * c5 * t + 4.0 * c4) * t + 3.0 * c3) * t + 2.0 * c2) * t + motion->C[1][i];
        second[i] = ((20.0 * c5 * t + 12.0 * c4) * t + 6.0 * c3) * t + 2.0 * c2;
    }
    arm_course_rates(phi, first, second, twist, rate);
}

/* Begin a motion with a twist and its derivative. */
static void arm_begin(arm_motion *motion, const arm_course *start, const double twist[6], const double rate[6],
                      double time)
{
    int i;
    motion->start = *start;
    motion->duration = time;
    for (i = 0; i < 6; i++) {
        motion->C[0][i] = motion->C[3][i] = motion->C[4][i] = motion->C[5][i] = 0.0;
        motion->C[1][i] = twist[i];
        motion->C[2][i] = rate[i] / 2.0;
    }
}

/* Change the derivative of the twist linearly to another one. */
static void arm_change(arm_motion *motion, const arm_course *start, const double twist[6], const double rate[6],
                       const double later[6], double time)
{
    int i;
    arm_begin(motion, start, twist, rate, time);
    for (i = 0; i < 6; i++) motion->C[3][i] = (later[i] - rate[i]) / (6.0 * time);
}

/* Bring a twist and its derivative to 0: cubic in time. */
static void arm_brake(arm_motion *motion, const arm_course *start, const double twist[6], const double rate[6],
                      double time)
{
    int i;
    arm_begin(motion, start, twist, rate, time);
    for (i = 0; i < 6; i++) {
        motion->C[3][i] = -twist[i] / (time * time) - 2.0 * rate[i] / (3.0 * time);
        motion->C[4][i] = twist[i] / (2.0 * time * time * time) + rate[i] / (4.0 * time * time);
    }
}

/* Come to rest after a displacement: quintic in time. */
static void arm_land(arm_motion *motion, const arm_course *start, const double twist[6], const double rate[6],
                     const double way[6], double time)
{
    const double square = time * time, cube = square * time;
    int i;
    arm_begin(motion, start, twist, rate, time);
    for (i = 0; i < 6; i++) {
        const double D = way[i] - time * twist[i] - square / 2.0 * rate[i], V = -twist[i] - time * rate[i];
        motion->C[3][i] = (10.0 * D - 4.0 * time * V - square / 2.0 * rate[i]) / cube;
        motion->C[4][i] = (-15.0 * D + 7.0 * time * V + square * rate[i]) / (cube * time);
        motion->C[5][i] = (6.0 * D - 3.0 * time * V - square / 2.0 * rate[i]) / (cube * square);
    }
}

/* ---- governor: polynomials of the joints -------------------------------------------------------------------- */

/* Chebyshev-Lobatto nodes from 0 to 1; extrapolation to node j from the derivative at node 0, column j, and the nodes
 * before j; coefficients of 1, u, u^2, ... from values at the nodes. */
static const double arm_share[2][ARM_DEGREE + 1] = {@shareshort, @sharelong};
static const double arm_ahead[2][ARM_DEGREE + 1][ARM_DEGREE + 1] = {{
@aheadshort}, {
@aheadlong}};
static const double arm_monomials[2][ARM_DEGREE + 1][ARM_DEGREE + 1] = {{
@monomialsshort}, {
@monomialslong}};
static const int arm_degree[2] = {@short, @long};

static void arm_piece_at(const arm_piece *piece, double t, double q[ARM_N])
{
    const double u = (2.0 * t - (piece->begin + piece->end)) / (piece->end - piece->begin);
    int i, k;
    for (i = 0; i < ARM_N; i++) q[i] = piece->C[piece->degree][i];
    for (k = piece->degree - 1; k >= 0; k--)
        for (i = 0; i < ARM_N; i++) q[i] = q[i] * u + piece->C[k][i];
}

static void arm_piece_derivatives(const arm_piece *piece, double t, double qdot[ARM_N], double qddot[ARM_N])
{
    const double scale = 2.0 / (piece->end - piece->begin);
    const double u = (2.0 * t - (piece->begin + piece->end)) / (piece->end - piece->begin);
    const int d = piece->degree;
    int i, k;
    for (i = 0; i < ARM_N; i++) {
        double first = d * piece->C[d][i], second = d * (d - 1) * piece->C[d][i];
        for (k = d - 1; k > 0; k--) {
            first = first * u + k * piece->C[k][i];
            if (k > 1) second = second * u + k * (k - 1) * piece->C[k][i];
        }
        qdot[i] = first * scale;
        qddot[i] = second * scale * scale;
    }
}

/* Find the piece of a plan at a time; NULL after its end. */
static const arm_piece *arm_piece_of(const arm_plan *plan, double t)
{
    int k;
    for (k = 0; k < plan->pieces; k++)
        if (t <= plan->piece[k].end) return &plan->piece[k];
    return NULL;
}

static void arm_plan_at(const arm_plan *plan, double t, double q[ARM_N])
{
    const arm_piece *piece = arm_piece_of(plan, t);
    int i;
    if (piece)
        arm_piece_at(piece, t, q);
    else
        for (i = 0; i < ARM_N; i++) q[i] = plan->q[i];
}

static void arm_plan_rates(const arm_plan *plan, double t, double twist[6], double rate[6])
{
    int i, k;
    for (k = 0; k < plan->motions; k++) {
        const arm_motion *motion = &plan->motion[k];
        if (t <= motion->begin + motion->duration) {
            arm_rates(motion, t - motion->begin, twist, rate);
            return;
        }
    }
    for (i = 0; i < 6; i++) twist[i] = rate[i] = 0.0;
}

static void arm_plan_course(const arm_plan *plan, double t, arm_course *course)
{
    int k;
    *course = plan->start;
    for (k = 0; k < plan->motions; k++) {
        const arm_motion *motion = &plan->motion[k];
        const double end = motion->begin + motion->duration;
        arm_moved(motion, (t < end ? t : end) - motion->begin, course);
        if (t <= end) return;
    }
}

static void arm_plan_begin(arm_plan *plan, const arm_course *start, const double q[ARM_N], const double qdot[ARM_N])
{
    int i;
    plan->start = *start;
    plan->motions = plan->pieces = plan->lands = 0;
    plan->time = 0.0;
    for (i = 0; i < ARM_N; i++) {
        plan->q[i] = q[i];
        plan->qdot[i] = qdot[i];
    }
}

/* Solve f(q) = x, h(q) = c near q; return 0 without a solution inside the region. */
static int arm_solved(arm_governor *g, const arm_pose *target, double q[ARM_N])
{
    arm_options options;
    int i, k;
    arm_defaults(&options);
    options.stay_inside = 0;
    g->outside = 0;
    for (k = 0; k < 6; k++) {
        double x[ARM_N], size = 0.0;
        if (--g->left < 0) return 0;
        if (arm_step(q, target, 1.0, NULL, g->leaf, &options, NULL, x) != ARM_OK) return 0;
        for (i = 0; i < ARM_N; i++) {
            if (!(fabs(x[i] - q[i]) <= size)) size = fabs(x[i] - q[i]);
            q[i] = x[i];
        }
        if (!(size < 0.3)) return 0;
        if (size < 1e-6) {
            g->outside = arm_inside(q) != ARM_OK;
            return !g->outside;
        }
    }
    return 0;
}

/* Interpolate a motion between two times; return 0 if it fails. */
static int arm_interpolate(arm_governor *g, const arm_motion *motion, double begin, double end, const arm_plan *plan,
                           int table, arm_piece *piece, double last[ARM_N])
{
    double Q[ARM_DEGREE + 1][ARM_N];
    int i, j, k;
    piece->degree = arm_degree[table];
    for (i = 0; i < ARM_N; i++) Q[0][i] = plan->q[i];
    for (j = 1; j <= piece->degree; j++) {
        arm_course target;
        for (i = 0; i < ARM_N; i++) {
            double guess = 0.0;
            for (k = 0; k < j; k++) guess += arm_ahead[table][j][k] * Q[k][i];
            Q[j][i] = guess + arm_ahead[table][j][j] * ((end - begin) * plan->qdot[i]);
        }
        arm_moved(motion, begin + arm_share[table][j] * (end - begin), &target);
        if (!arm_solved(g, &target.place, Q[j])) return 0;
    }
    for (i = 0; i < ARM_N; i++) last[i] = Q[piece->degree][i];
    for (k = 0; k <= piece->degree; k++)
        for (i = 0; i < ARM_N; i++) {
            double c = 0.0;
            for (j = 0; j <= piece->degree; j++) c += arm_monomials[table][k][j] * Q[j][i];
            piece->C[k][i] = c;
        }
    return 1;
}

/* Append motion[motions] to a plan, in count pieces or more; return their number, 0 if it fails. */
static int arm_append(arm_governor *g, arm_plan *plan, int table, int count)
{
    arm_motion *motion = &plan->motion[plan->motions];
    const double begin = plan->time, T = motion->duration;
    double done = 0.0, width = T / count;
    int made = 0, i;
    while (done < T) {
        const double end = T - done < 1.3 * width ? T : done + width;
        arm_piece *piece;
        double last[ARM_N], size = 0.0, spare[ARM_N];
        if (plan->pieces == ARM_PIECES) return 0;
        piece = &plan->piece[plan->pieces];
        if (!arm_interpolate(g, motion, done, end, plan, table, piece, last)) return 0;
        for (i = 0; i < ARM_N; i++)
            if (!(fabs(piece->C[piece->degree][i]) <= size)) size = fabs(piece->C[piece->degree][i]);
        if (!(ldexp(size, 1 - piece->degree) <= 3e-11)) {
            width = (end - done) / 2.0;
            if (width < T / 64.0) return 0;
            continue;
        }
        piece->begin = begin + done;
        piece->end = begin + end;
        arm_piece_derivatives(piece, begin + end, plan->qdot, spare);
        for (i = 0; i < ARM_N; i++) plan->q[i] = last[i];
        plan->pieces++;
        done = end;
        made++;
    }
    motion->begin = begin;
    plan->motions++;
    plan->time = begin + T;
    return made;
}

/* ---- governor: the law -------------------------------------------------------------------------------------- */

#define ARM_TINY 1e-300
#define ARM_STRIDE @stride /* time between two plans, s */

/* Shares of the limits that plans aim at; braking is for targets and joint limits. */
#define ARM_AIM_SPEED @speed
#define ARM_AIM_ACCELERATION @acceleration
#define ARM_AIM_JERK @jerk
#define ARM_AIM_BRAKING @braking

/* State at the beginning of a plan: qdot = B twist, qddot = B rate + bend; later: the rate of the last stop after a
 * stride. */
typedef struct {
    arm_course course;
    double q[ARM_N], qdot[ARM_N], G[ARM_N * ARM_M], B[ARM_N * 6], B_ahead[ARM_N * 6];
    double twist[6], rate[6], later[6], bend[ARM_N], room[ARM_N];
} arm_now;

/* Speed from which a deceleration a after a delay stops within a distance; a can be infinite. */
static double arm_approach(double distance, double a, double lag)
{
    if (distance <= 0.0) return 0.0;
    if (lag * lag * a > 1e12 * distance) return distance / lag;
    return a * (sqrt(lag * lag + 2.0 * distance / a) - lag);
}

/* Acceleration beyond which a stop within a distance becomes no shorter. */
static double arm_peak(double distance, double jerk) { return cbrt(jerk * jerk * distance); }

/* Speed from which a stop after a delay ends within a distance: the deceleration rises to at most a and falls to 0 at a
 * rate of at most jerk. */
static double arm_arrival(double distance, double a, double jerk, double lag)
{
    if (distance <= 0.0) return 0.0;
    if (arm_peak(distance, jerk) < a) a = arm_peak(distance, jerk);
    return arm_approach(distance, a, lag + a / (2.0 * jerk));
}

/* Compute B x for a velocity x in the coordinates of the course. */
static void arm_joint_rates(const double *B, const double twist[6], double x[ARM_N])
{
    int a, i;
    for (i = 0; i < ARM_N; i++) {
        x[i] = 0.0;
        for (a = 0; a < 6; a++) x[i] += B[i * 6 + a] * twist[a];
    }
}

/* B = G E. */
static void arm_joint_columns(const double *G, const double *E, double *B)
{
    int a, b, i;
    for (i = 0; i < ARM_N; i++)
        for (b = 0; b < 6; b++) {
            B[i * 6 + b] = 0.0;
            for (a = 0; a < ARM_M; a++) B[i * 6 + b] += G[i * ARM_M + a] * E[a * 6 + b];
        }
}

/* Evaluate the state at this tick; return 0 at a singularity. */
static int arm_governor_now(const arm_governor *g, arm_now *now)
{
    const arm_plan *plan = &g->plan[g->taken];
    const double t = (double)g->tick * g->dt;
    const arm_piece *piece = arm_piece_of(plan, t);
    double ahead[ARM_N], qddot[ARM_N], spare[6], x[ARM_N], E[ARM_M * 6], G[ARM_N * ARM_M];
    int i;
    for (i = 0; i < ARM_N; i++) {
        now->q[i] = g->history[2][i];
        now->qdot[i] = qddot[i] = 0.0;
    }
    arm_plan_course(plan, t, &now->course);
    arm_course_at(now->q, &now->course);
    arm_plan_rates(plan, t, now->twist, now->rate);
    arm_plan_rates(plan, t + g->stride, spare, now->later);
    if (piece) arm_piece_derivatives(piece, t, now->qdot, qddot);
    for (i = 0; i < ARM_N; i++) ahead[i] = now->q[i] + 2.0 * g->stride * now->qdot[i];
    if (arm_inverse(now->q, now->G) != ARM_OK || arm_inverse(ahead, G) != ARM_OK) return 0;
    arm_task_rates(&now->course, E);
    arm_joint_columns(now->G, E, now->B);
    arm_joint_columns(G, E, now->B_ahead);
    arm_joint_rates(now->B, now->rate, x);
    for (i = 0; i < ARM_N; i++) {
        const double A = g->limits.acceleration[i];
        now->bend[i] = qddot[i] - x[i];
        now->room[i] = A - fabs(now->bend[i]) > 0.3 * A ? A - fabs(now->bend[i]) : 0.3 * A;
    }
    return 1;
}

/* Find the largest speeds along a direction, in shares of it per s: by the speed limits, and by the joint limits. */
static void arm_fastest(const arm_governor *g, const arm_now *now, const double way[6], double *by_speed,
                        double *by_room)
{
    double x[ARM_N], ahead[ARM_N];
    int i;
    arm_joint_rates(now->B, way, x);
    arm_joint_rates(now->B_ahead, way, ahead);
    *by_speed = *by_room = HUGE_VAL;
    for (i = 0; i < ARM_N; i++) {
        const double room = x[i] > 0.0 ? g->upper[i] - now->q[i] : now->q[i] - g->lower[i];
        const double here = fabs(x[i]) > ARM_TINY ? fabs(x[i]) : ARM_TINY;
        const double size = fabs(ahead[i]) > here ? fabs(ahead[i]) : here;
        const double a = ARM_AIM_BRAKING * g->limits.acceleration[i], jerk = ARM_AIM_JERK * g->limits.jerk[i];
        const double toward = arm_arrival(room, a, jerk, 2.0 * g->stride) / here;
        const double speed = ARM_AIM_SPEED * g->limits.velocity[i] / size;
        if (speed < *by_speed) *by_speed = speed;
        if (toward < *by_room) *by_room = toward;
    }
}

/* Compute the deceleration before a target and its largest rate of change, in shares of the joint displacement x. */
static double arm_braking(const arm_governor *g, const arm_now *now, const double x[ARM_N], double *jerk)
{
    double a = HUGE_VAL;
    int i;
    *jerk = HUGE_VAL;
    for (i = 0; i < ARM_N; i++) {
        const double size = fabs(x[i]) > ARM_TINY ? fabs(x[i]) : ARM_TINY;
        if (now->room[i] / size < a) a = now->room[i] / size;
        if (g->limits.jerk[i] / size < *jerk) *jerk = g->limits.jerk[i] / size;
    }
    *jerk *= ARM_AIM_BRAKING * ARM_AIM_JERK;
    a *= ARM_AIM_BRAKING;
    return arm_peak(1.0, *jerk) < a ? arm_peak(1.0, *jerk) : a;
}

/* Speed and acceleration along the joint displacement x, in shares of it. */
static void arm_closing(const arm_now *now, const double x[ARM_N], double *speed, double *a)
{
    double y[ARM_N], z[ARM_N], square = 0.0;
    int i;
    *speed = *a = 0.0;
    arm_joint_rates(now->B, now->twist, y);
    arm_joint_rates(now->B, now->rate, z);
    for (i = 0; i < ARM_N; i++) {
        square += x[i] * x[i];
        *speed += x[i] * y[i];
        *a += x[i] * z[i];
    }
    if (!(square >= ARM_TINY)) square = ARM_TINY;
    *speed /= square;
    *a /= square;
}

/* Way on which an acceleration a > 0 falls to 0; 0 for a deceleration. */
static double arm_release(double speed, double a, double jerk)
{
    const double t = a > 0.0 ? a / jerk : 0.0;
    return speed * t + a * t * t / 3.0;
}

/* Time beyond which the quintic to rest over the distance 1 overshoots: its last derivatives are 0, 0 and
 * (60 - 24 T speed - 3 T^2 a) / T^3. */
static double arm_longest_landing(double speed, double a)
{
    const double root = 4.0 * speed * speed + 5.0 * a;
    const double rate = root >= 0.0 ? 2.0 * speed + sqrt(root) : 0.0;
    return rate > 0.0 ? 10.0 / rate : HUGE_VAL;
}

/* Choose the derivative of the twist after the next stride, on the way to another twist. */
static void arm_accelerate(const arm_governor *g, const arm_now *now, const double wish[6], double later[6])
{
    const double T = g->stride;
    double gap[6], change[6], x[ARM_N], fits = HUGE_VAL, jerk = HUGE_VAL, most = HUGE_VAL, share;
    int i;
    for (i = 0; i < 6; i++) gap[i] = wish[i] - now->twist[i] - T / 2.0 * now->rate[i];
    arm_joint_rates(now->B, gap, x);
    for (i = 0; i < ARM_N; i++) {
        const double size = fabs(x[i]) > ARM_TINY ? fabs(x[i]) : ARM_TINY;
        const double sign = x[i] > 0.0 ? 1.0 : x[i] < 0.0 ? -1.0 : 0.0;
        const double room = (ARM_AIM_ACCELERATION * g->limits.acceleration[i] - sign * now->bend[i]) / size;
        if (room < fits) fits = room;
        if (g->limits.jerk[i] / size < jerk) jerk = g->limits.jerk[i] / size;
    }
    share = arm_approach(1.0, ARM_AIM_JERK * jerk, T);
    if (!(fits > 0.0)) fits = 0.0;
    if (fits < share) share = fits;
    for (i = 0; i < 6; i++) change[i] = share * gap[i] - now->rate[i];
    arm_joint_rates(now->B, change, x);
    for (i = 0; i < ARM_N; i++) {
        const double size = fabs(x[i]) > ARM_TINY ? fabs(x[i]) : ARM_TINY;
        if (ARM_AIM_JERK * g->limits.jerk[i] * T / size < most) most = ARM_AIM_JERK * g->limits.jerk[i] * T / size;
    }
    if (most > 1.0) most = 1.0;
    for (i = 0; i < 6; i++) later[i] = now->rate[i] + most * change[i];
}

/*
 * Measure the samples of a plan: the largest shares of the limits that are used before and after a time, and whether
 * the joints stay inside their limits. Speeds count as before: a longer stop does not lower them.
 */
static int arm_used(const arm_governor *g, const arm_plan *plan, double begin, double *before, double *after)
{
    const double dt = g->dt;
    const long last = (long)ceil(plan->time / dt) + 3;
    double H[3][ARM_N], per_speed[ARM_N], per_acceleration[ARM_N], per_jerk[ARM_N];
    double speed = 0.0, first = 0.0, later = 0.0;
    long k;
    int i, piece = 0;
    for (i = 0; i < ARM_N; i++) {
        per_speed[i] = 1.0 / (g->limits.velocity[i] * dt);
        per_acceleration[i] = 1.0 / (g->limits.acceleration[i] * dt * dt);
        per_jerk[i] = 1.0 / (g->limits.jerk[i] * dt * dt * dt);
    }
    for (k = 0; k < 3; k++)
        for (i = 0; i < ARM_N; i++) H[k][i] = g->history[k][i];
    for (k = 1; k <= last; k++) {
        const double t = (double)k * dt;
        double q[ARM_N], worst = 0.0;
        while (piece < plan->pieces && t > plan->piece[piece].end) piece++;
        if (piece < plan->pieces)
            arm_piece_at(&plan->piece[piece], t, q);
        else
            for (i = 0; i < ARM_N; i++) q[i] = plan->q[i];
        for (i = 0; i < ARM_N; i++) {
            const double d1 = q[i] - H[2][i], e1 = H[2][i] - H[1][i], d2 = d1 - e1;
            const double d3 = d2 - (e1 - (H[1][i] - H[0][i]));
            const double v = fabs(d1) * per_speed[i], a = fabs(d2) * per_acceleration[i];
            const double j = fabs(d3) * per_jerk[i];
            if (!(q[i] >= g->lower[i] - 1e-12 && q[i] <= g->upper[i] + 1e-12)) return 0;
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

/* Smallest sine of the angle between a row of J and the other rows of J_V; 0 is singular. */
static double arm_regularity(const double q[ARM_N])
{
    double J[ARM_M * ARM_N], G[ARM_N * ARM_M], worst = 0.0;
    int a, i;
    if (arm_jacobian(q, J) != ARM_OK || arm_inverse(q, G) != ARM_OK) return 0.0;
    for (a = 0; a < ARM_M; a++) {
        double row = 0.0, column = 0.0;
        for (i = 0; i < ARM_N; i++) {
            row += J[a * ARM_N + i] * J[a * ARM_N + i];
            column += G[i * ARM_M + a] * G[i * ARM_M + a];
        }
        if (!(row * column <= worst)) worst = row * column;
    }
    return 1.0 / sqrt(worst);
}

/* Tell whether an arm at rest at q can leave it: q is not, or not more than now, singular. */
static int arm_leaves(const double q[ARM_N], const arm_now *now)
{
    const double there = arm_regularity(q);
    return there > 0.0 && (there >= @regular || there >= arm_regularity(now->q));
}

static arm_status arm_failure(const arm_governor *g)
{
    if (g->left < 0) return ARM_SLOWED;
    return g->outside ? ARM_OUTSIDE : ARM_SINGULAR;
}

/* Append a motion, in pieces as long as the last ones could be. */
static int arm_append_long(arm_governor *g, arm_plan *plan, double travel)
{
    const double parts = ceil(travel / g->reach);
    const int count = parts > 16.0 ? 16 : parts > 1.0 ? (int)parts : 1;
    const int made = arm_append(g, plan, 1, count);
    if (made) {
        g->reach = travel / made > 1e-3 ? travel / made : 1e-3;
        if (made == count) g->reach = 0.15;
    } else if (g->left < 0)
        g->reach = 0.15; /* shorter pieces are more than a tick can evaluate */
    return made;
}

/* Count the samples of a plan as evaluations, as they take as long; return 0 if too few are left. */
static int arm_affords(arm_governor *g, const arm_plan *plan)
{
    const double count = plan->time / g->dt / @samples;
    g->left -= count < @mostsamples ? (int)count : @mostsamples;
    return g->left >= 0;
}

static void arm_take(arm_governor *g)
{
    g->taken = 1 - g->taken;
    g->tick = 0;
}

/* Add a stop to a plan, as short as the limits allow; take the plan if it serves. */
static arm_status arm_stop(arm_governor *g, arm_plan *plan, const arm_now *now, const arm_course *course,
                           const double twist[6], const double rate[6])
{
    const int motions = plan->motions, pieces = plan->pieces;
    const double begin = plan->time;
    double x[ARM_N], q[ARM_N], qdot[ARM_N], fast = 0.0, shortest = 0.0, jerk = 0.0;
    int i, k;
    arm_joint_rates(now->B, twist, x);
    for (i = 0; i < ARM_N; i++) {
        const double size = fabs(x[i]), time = 1.5 * size / (ARM_AIM_ACCELERATION * now->room[i]);
        if (size > fast) fast = size;
        if (time > shortest) shortest = time;
        if (6.0 * size / (ARM_AIM_JERK * g->limits.jerk[i]) > jerk) jerk = 6.0 * size / (ARM_AIM_JERK * g->limits.jerk[i]);
        q[i] = plan->q[i];
        qdot[i] = plan->qdot[i];
    }
    if (sqrt(jerk) > shortest) shortest = sqrt(jerk);
    for (k = 0; k < 2; k++) {
        double T = g->longer * shortest, before, after;
        if (T < 4.0 * g->dt) T = 4.0 * g->dt;
        plan->motions = motions;
        plan->pieces = pieces;
        plan->time = begin;
        for (i = 0; i < ARM_N; i++) {
            plan->q[i] = q[i];
            plan->qdot[i] = qdot[i];
        }
        arm_brake(&plan->motion[motions], course, twist, rate, T);
        if (!arm_append_long(g, plan, fast * T / 2.0)) return arm_failure(g);
        if (!arm_leaves(plan->q, now)) return ARM_SINGULAR;
        if (!arm_affords(g, plan)) return ARM_SLOWED;
        if (!arm_used(g, plan, begin, &before, &after)) return ARM_LIMIT;
        if (!(before <= 1.0)) return ARM_SLOWED;
        if (after <= 1.0) {
            g->longer = 0.98 * g->longer > 1.0 ? 0.98 * g->longer : 1.0;
            arm_take(g);
            return ARM_OK;
        }
        g->longer *= 1.05 * after < 1.6 ? 1.05 * after : 1.6;
        if (g->longer > 4.0) g->longer = 4.0;
    }
    return ARM_SLOWED;
}

/* Plan a stride, the end of its acceleration, and a stop; take the plan if it serves. */
static arm_status arm_try(arm_governor *g, const arm_now *now, const double later[6])
{
    arm_plan *plan = &g->plan[1 - g->taken];
    arm_motion *motion = plan->motion;
    arm_course course;
    double twist[6], rate[6], x[ARM_N], release = g->dt;
    int i, bounded = 1;
    arm_plan_begin(plan, &now->course, now->q, now->qdot);
    arm_change(motion, &now->course, now->twist, now->rate, later, g->stride);
    if (!arm_append(g, plan, 0, 1)) return arm_failure(g);
    arm_moved(motion, g->stride, &course);
    arm_rates(motion, g->stride, twist, rate);
    arm_joint_rates(now->B, rate, x);
    for (i = 0; i < ARM_N; i++) {
        if (!(g->limits.jerk[i] < HUGE_VAL)) bounded = 0;
        if (fabs(x[i]) / (ARM_AIM_JERK * g->limits.jerk[i]) > release) release = fabs(x[i]) / (ARM_AIM_JERK * g->limits.jerk[i]);
    }
    if (bounded) {
        const double zero[6] = {0.0};
        arm_course start = course;
        motion++;
        arm_change(motion, &start, twist, rate, zero, release);
        if (!arm_append(g, plan, release > 0.02, 1)) return arm_failure(g);
        arm_moved(motion, release, &course);
        arm_rates(motion, release, twist, rate);
    } else
        for (i = 0; i < 6; i++) rate[i] = 0.0;
    return arm_stop(g, plan, now, &course, twist, rate);
}

/* Plan to come to rest at a displacement, if it is near; return 1 if the plan is taken. */
static int arm_try_landing(arm_governor *g, const arm_now *now, const double way[6], const double x[ARM_N], double a,
                           double jerk, double speed, double closing, double rise)
{
    static const double longer[2][3] = {{1.0, 1.15, 1.4}, {0.95, 1.0, 1.05}};
    arm_plan *plan = &g->plan[1 - g->taken];
    double travel = 0.0, T, before, after;
    int i, fast;
    for (i = 0; i < ARM_N; i++)
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
    if (arm_longest_landing(closing, rise) < T) T = arm_longest_landing(closing, rise);
    if (T < 3.0 * g->dt) T = 3.0 * g->dt;
    arm_plan_begin(plan, &now->course, now->q, now->qdot);
    plan->lands = 1;
    arm_land(plan->motion, &now->course, now->twist, now->rate, way, T);
    if (!arm_append_long(g, plan, travel) || !arm_leaves(plan->q, now)) return 0;
    if (!arm_affords(g, plan)) return 0;
    if (!arm_used(g, plan, 0.0, &before, &after) || !(before <= 1.0) || !(after <= 1.0)) return 0;
    arm_take(g);
    return 1;
}

/* Tell whether joint speeds are negligible. */
static int arm_slow(const arm_governor *g, const double x[ARM_N])
{
    int i;
    for (i = 0; i < ARM_N; i++)
        if (!(fabs(x[i]) <= 1e-6 * g->limits.velocity[i])) return 0;
    return 1;
}

/* Tell whether the velocity is the one asked for. */
static arm_status arm_reached(const arm_governor *g, const arm_now *now, const double way[6])
{
    double away[6], x[ARM_N];
    int i;
    for (i = 0; i < 6; i++) away[i] = way[i] - now->twist[i];
    arm_joint_rates(now->B, away, x);
    return arm_slow(g, x) ? ARM_OK : ARM_SLOWED;
}

/* Go on in a direction for a stride, as fast as the limits allow. */
static arm_status arm_drive(arm_governor *g, const arm_now *now, const double way[6], double asked, int lands)
{
    double by_speed, by_room, speed, wish[6], later[6];
    arm_status cause;
    int i;
    for (i = 0; i < 6 && way[i] == 0.0; i++)
        ;
    if (i == 6) return arm_reached(g, now, way);
    arm_fastest(g, now, way, &by_speed, &by_room);
    speed = (by_speed < by_room ? by_speed : by_room) * g->pace;
    if (asked < speed) speed = asked;
    for (i = 0; i < 6; i++) wish[i] = way[i] * speed;
    arm_accelerate(g, now, wish, later);
    cause = arm_try(g, now, later);
    if (cause == ARM_SLOWED) {
        for (i = 0; i < 6; i++) later[i] = (now->later[i] + later[i]) / 2.0;
        arm_try(g, now, later);
        return cause;
    }
    if (cause != ARM_OK) {
        g->pace = 0.7 * g->pace > 1e-3 ? 0.7 * g->pace : 1e-3;
        g->cause = cause;
        return cause;
    }
    g->pace = 1.1 * g->pace < 1.0 ? 1.1 * g->pace : 1.0;
    if (g->pace < 1.0) return g->cause;
    if (by_room < by_speed && by_room < asked) return ARM_LIMIT;
    return lands ? ARM_SLOWED : arm_reached(g, now, way);
}

static int arm_same_pose(const arm_pose *a, const arm_pose *b)
{
    int i;
    for (i = 0; i < 3; i++)
        if (a->p[i] != b->p[i]) return 0;
    for (i = 0; i < 9; i++)
        if (a->R[i] != b->R[i]) return 0;
    return 1;
}

/* Begin with the straight line from the start to a target. */
static void arm_line_begin(arm_governor *g, const arm_pose *target)
{
    arm_line *line = &g->line;
    const double zero[6] = {0.0};
    double way[6];
    int i;
    arm_way(&line->course, target, way);
    arm_begin(&line->motion, &line->course, way, zero, 1.0);
    line->target = *target;
    line->share = 0.0;
    line->step = line->begun = 1;
    line->known = line->found = 0;
    for (i = 0; i < ARM_N; i++) line->q[i] = line->start[i];
}

/* Solve f(q) = x, h(q) = c next to q, inside all limits. */
static int arm_line_solved(const arm_governor *g, const arm_pose *target, double q[ARM_N], int *left)
{
    arm_options options;
    double before = HUGE_VAL;
    int i, k;
    arm_defaults(&options);
    options.stay_inside = 0;
    for (k = 0; k < 6; k++) {
        double x[ARM_N], size = 0.0, most = @contraction * before < @longest ? @contraction * before : @longest;
        --*left;
        if (arm_step(q, target, 1.0, NULL, g->leaf, &options, NULL, x) != ARM_OK) return 0;
        for (i = 0; i < ARM_N; i++) {
            if (!(fabs(x[i] - q[i]) <= size)) size = fabs(x[i] - q[i]);
            q[i] = x[i];
        }
        if (!(size <= (most > 1e-6 ? most : 1e-6))) return 0;
        if (size < 1e-6) {
            for (i = 0; i < ARM_N; i++)
                if (!(q[i] >= g->lower[i] && q[i] <= g->upper[i])) return 0;
            return arm_inside(q) == ARM_OK;
        }
        before = size;
    }
    return 0;
}

/* Go on with the joints of a target: continuation along the straight line from the start, by a number of evaluations. */
static void arm_look_for(arm_governor *g, const arm_pose *target)
{
    arm_line *line = &g->line;
    int left = @atonce, i;
    if (!line->begun || !arm_same_pose(target, &line->target)) arm_line_begin(g, target);
    while (!line->known && left > 0) {
        const double end = line->share + line->step < 1.0 ? line->share + line->step : 1.0;
        double q[ARM_N];
        arm_course course;
        for (i = 0; i < ARM_N; i++) q[i] = line->q[i];
        arm_moved(&line->motion, end, &course);
        if (!arm_line_solved(g, &course.place, q, &left)) {
            line->step /= 2.0;
            line->known = line->step < 1e-3;
            continue;
        }
        for (i = 0; i < ARM_N; i++) line->q[i] = q[i];
        line->share = end;
        line->step *= 2.0;
        line->known = line->found = end == 1.0;
    }
}

/* Tell whether the joints at a target are those of the target; if not, take the way there. */
static int arm_is_there(arm_governor *g, const double q[ARM_N])
{
    const arm_line *line = &g->line;
    int i;
    for (i = 0; line->found && i < ARM_N; i++)
        if (!(fabs(q[i] - line->q[i]) <= 1e-7)) g->by_joints = 1;
    return line->known && !g->by_joints;
}

/* Remove from x its parts along V[0], V[1], ..., which are orthonormal. */
static void arm_project(const double V[ARM_R][ARM_N], int count, double x[ARM_N])
{
    int i, k;
    for (k = 0; k < count; k++) {
        double part = 0.0;
        for (i = 0; i < ARM_N; i++) part += V[k][i] * x[i];
        for (i = 0; i < ARM_N; i++) x[i] -= part * V[k][i];
    }
}

/* Direct q towards a goal on its leaf: (I - V V+)(goal - q), and along a singularity if one is near. */
static void arm_leaf_direction(const double q[ARM_N], const double goal[ARM_N], double d[ARM_N])
{
    double V[ARM_R][ARM_N], h[ARM_R], slope[ARM_N], at[ARM_N], square = 0.0, size = 0.0, along = 0.0, push;
    const double here = arm_regularity(q);
    int i, k;
    arm_potentials(q, h, V);
    for (k = 0; k < ARM_R; k++) {
        double length = 0.0;
        arm_project((const double(*)[ARM_N])V, k, V[k]);
        for (i = 0; i < ARM_N; i++) length += V[k][i] * V[k][i];
        for (i = 0; i < ARM_N; i++) V[k][i] /= sqrt(length);
    }
    for (i = 0; i < ARM_N; i++) d[i] = goal[i] - q[i];
    arm_project((const double(*)[ARM_N])V, ARM_R, d);
    if (here >= @along) return;
    for (i = 0; i < ARM_N; i++) at[i] = q[i];
    for (i = 0; i < ARM_N; i++) {
        at[i] = q[i] + 1e-5;
        slope[i] = (arm_regularity(at) - here) / 1e-5;
        at[i] = q[i];
    }
    arm_project((const double(*)[ARM_N])V, ARM_R, slope);
    for (i = 0; i < ARM_N; i++) {
        square += slope[i] * slope[i];
        size += d[i] * d[i];
        along += slope[i] * d[i];
    }
    if (!(square >= ARM_TINY)) square = ARM_TINY;
    push = @push * (1.0 - here / @along) * sqrt(square * size) - along;
    if (!(push > 0.0)) return;
    for (i = 0; i < ARM_N; i++) d[i] += push / square * slope[i];
}

/* Direct the frame so that the joints approach those of the target, along the leaf. */
static void arm_way_of_joints(arm_governor *g, const arm_now *now, double way[6], double x[ARM_N])
{
    double J[ARM_M * ARM_N], rate[ARM_M], d[ARM_N], size = 0.0, miss = 0.0;
    int a, i;
    for (i = 0; i < ARM_N; i++) {
        const double apart = g->line.q[i] - now->q[i];
        if (!(fabs(apart) <= size)) size = fabs(apart);
        if (!(fabs(apart - x[i]) <= miss)) miss = fabs(apart - x[i]);
    }
    if (size < 0.3 && miss < 0.1 * size) {
        g->by_joints = 0;
        return;
    }
    arm_leaf_direction(now->q, g->line.q, d);
    arm_jacobian(now->q, J);
    for (a = 0; a < ARM_M; a++) {
        rate[a] = 0.0;
        for (i = 0; i < ARM_N; i++) rate[a] += J[a * ARM_N + i] * d[i];
    }
    arm_velocity_along(&now->course, rate, way);
    arm_joint_rates(now->B, way, x);
}

/* Take the way of the joints, as the straight line is blocked; return 1 while they are looked for. At the edge of a
 * cell, come to rest and begin again: from rest, the straight line does not leave the cell. */
static int arm_other_way(arm_governor *g, const arm_pose *target, int rests)
{
    if (arm_bounded && g->status == ARM_OUTSIDE) {
        if (!rests) return 1;
        g->stuck = g->by_joints = 0;
        g->pace = 1.0;
        return 0;
    }
    arm_look_for(g, target);
    if (!g->line.known) return 1;
    g->by_joints |= g->line.found;
    g->stuck = 0;
    return 0;
}

/* Count the plans without progress. */
static void arm_count_stuck(arm_governor *g, const arm_now *now, arm_status status)
{
    int i, slow = status == ARM_LIMIT || status == ARM_OUTSIDE || status == ARM_SINGULAR;
    for (i = 0; i < ARM_N; i++)
        if (!(fabs(now->qdot[i]) < 0.02 * g->limits.velocity[i])) slow = 0;
    g->stuck = slow ? g->stuck + 1 : 0;
}

/* Move towards a target for a stride, or come to rest there. */
static arm_status arm_to_target(arm_governor *g, const arm_now *now, const arm_pose *target)
{
    const arm_plan *plan = &g->plan[g->taken];
    const int rests = (double)(g->tick - 3) * g->dt >= plan->time;
    const int lands = plan->lands && arm_same_pose(target, &g->landing);
    double way[6], x[ARM_N], travel = 0.0, a, jerk, speed, rise, left, by_speed, by_room;
    arm_status status;
    int i;
    if (lands) arm_look_for(g, target); /* only in ticks without a plan */
    if (lands && !rests) return ARM_SLOWED;
    if (g->stuck > 25 && arm_other_way(g, target, rests)) return g->status;
    arm_way(&now->course, target, way);
    arm_joint_rates(now->B, way, x);
    for (i = 0; i < ARM_N; i++)
        if (!(fabs(x[i]) <= travel)) travel = fabs(x[i]);
    if (lands || (rests && travel < 1e-10)) {
        if (!lands) arm_look_for(g, target);
        if (arm_is_there(g, now->q)) return arm_holds(target) ? ARM_OK : ARM_OUTSIDE;
        if (!g->by_joints) return ARM_SLOWED;
    }
    if (g->by_joints) arm_way_of_joints(g, now, way, x);
    a = arm_braking(g, now, x, &jerk);
    arm_closing(now, x, &speed, &rise);
    arm_fastest(g, now, way, &by_speed, &by_room);
    if (!g->by_joints && !g->exhausted && arm_try_landing(g, now, way, x, a, jerk, by_speed, speed, rise)) {
        g->landing = *target;
        g->pace = 1.0;
        return ARM_SLOWED;
    }
    g->exhausted = g->left < 0; /* by the landing: the next tick is for a stride */
    left = 1.0 - arm_release(speed, rise, jerk);
    status = arm_drive(g, now, way, arm_arrival(left, a, jerk, 2.0 * g->stride), 1);
    arm_count_stuck(g, now, status);
    return status;
}

/* Move by a twist of the frame for a stride. */
static arm_status arm_follow(arm_governor *g, const arm_now *now, const double *twist)
{
    double rate[ARM_M] = {0.0}, left_out[ARM_M], way[6], E[ARM_M * 6], x[ARM_N];
    arm_status status;
    int a, b, i;
    if (twist) arm_add_rate(now->course.place.R, twist, 1.0, rate);
    arm_velocity_along(&now->course, rate, way);
    status = arm_drive(g, now, way, 1.0, 0);
    arm_task_rates(&now->course, E);
    for (a = 0; a < ARM_M; a++) {
        left_out[a] = rate[a];
        for (b = 0; b < 6; b++) left_out[a] -= E[a * 6 + b] * way[b];
    }
    for (i = 0; i < ARM_N; i++) {
        x[i] = 0.0;
        for (a = 0; a < ARM_M; a++) x[i] += now->G[i * ARM_M + a] * left_out[a];
    }
    return status == ARM_OK && !arm_slow(g, x) ? ARM_OUTSIDE : status; /* along a coordinate of width 0 */
}

static int arm_small(const double *x, int count)
{
    int i;
    for (i = 0; i < count; i++)
        if (!(fabs(x[i]) < 1e6)) return 0;
    return 1;
}

/* Tell whether the last plan heeds an input, or whether it is newer. */
static int arm_heeded(const arm_governor *g, const arm_pose *target, const double *twist)
{
    int i;
    if (target) return g->heeds_target && arm_same_pose(target, &g->heard);
    if (g->heeds_target) return 0;
    for (i = 0; i < 6; i++)
        if ((twist ? twist[i] : 0.0) != g->heard_twist[i]) return 0;
    return 1;
}

/* ---- governor: functions of the header ---------------------------------------------------------------------- */

void arm_governor_limits(arm_limits *limits)
{
    static const double velocity[ARM_N] = @velocity;
    int i;
    for (i = 0; i < ARM_N; i++) {
        limits->velocity[i] = velocity[i];
        limits->acceleration[i] = 0.0;
        limits->jerk[i] = HUGE_VAL;
    }
    limits->margin = 0.0;
}

/* Begin at rest at q, if the arguments are right. */
static arm_status arm_rest(arm_governor *governor, const double q[ARM_N], double dt, const arm_limits *limits)
{
    static const double lower[ARM_N] = @lower;
    static const double upper[ARM_N] = @upper;
    double G[ARM_N * ARM_M], zero[ARM_N] = {0.0};
    arm_governor *g = governor;
    int i, k;
    if (!arm_finite(q, ARM_N) || !(dt > 0.0 && dt < HUGE_VAL)) return ARM_BAD_NUMBER;
    if (!(limits->margin >= 0.0 && limits->margin < HUGE_VAL)) return ARM_BAD_NUMBER;
    for (i = 0; i < ARM_N; i++) {
        if (!(limits->velocity[i] > 0.0 && limits->velocity[i] < HUGE_VAL)) return ARM_BAD_NUMBER;
        if (!(limits->acceleration[i] > 0.0 && limits->acceleration[i] < HUGE_VAL)) return ARM_BAD_NUMBER;
        if (!(limits->jerk[i] > 0.0)) return ARM_BAD_NUMBER;
        if (!(q[i] >= lower[i] + limits->margin && q[i] <= upper[i] - limits->margin)) return ARM_LIMIT;
    }
    if (arm_inside(q) != ARM_OK) return ARM_OUTSIDE;
    if (arm_inverse(q, G) != ARM_OK || arm_leaf(q, g->leaf) != ARM_OK) return ARM_SINGULAR;
    g->limits = *limits;
    g->dt = dt;
    g->ticks = ARM_STRIDE / dt >= 1.5 ? (long long)(ARM_STRIDE / dt + 0.5) : 1;
    g->stride = (double)g->ticks * dt;
    for (i = 0; i < ARM_N; i++) {
        g->lower[i] = lower[i] + limits->margin;
        g->upper[i] = upper[i] - limits->margin;
        for (k = 0; k < 3; k++) g->history[k][i] = q[i];
    }
    arm_course_begin(q, &g->line.course);
    arm_plan_begin(&g->plan[0], &g->line.course, q, zero);
    g->taken = g->turn = g->heeds_target = g->stuck = g->by_joints = g->exhausted = g->line.begun = 0;
    for (i = 0; i < ARM_N; i++) g->line.start[i] = q[i];
    for (i = 0; i < 6; i++) g->heard_twist[i] = 0.0;
    g->tick = 3; /* all differences are 0 */
    g->next = 0;
    g->pace = g->longer = 1.0;
    g->reach = 0.15;
    g->status = g->cause = ARM_OK;
    return ARM_OK;
}

arm_status arm_governor_start(arm_governor *governor, const double q[ARM_N], double dt, const arm_limits *limits)
{
    governor->status = arm_rest(governor, q, dt, limits);
    governor->started = governor->status == ARM_OK;
    return governor->status;
}

arm_status arm_governor_step(arm_governor *governor, const arm_pose *target, const double *twist, double q_next[ARM_N])
{
    arm_governor *g = governor;
    int i, usable = !(target && twist);
    if (!g->started) return g->status == ARM_OK ? ARM_BAD_NUMBER : g->status;
    if (target && !(arm_small(target->p, 3) && arm_rotation(target->R))) usable = 0;
    if (twist && !arm_small(twist, 6)) usable = 0;
    if (usable && g->tick >= g->next) {
        arm_now now;
        g->left = @most;
        if (!target || !g->heeds_target || !arm_same_pose(target, &g->heard)) g->stuck = g->by_joints = 0;
        if (!arm_governor_now(g, &now))
            g->status = ARM_SINGULAR;
        else if (target)
            g->status = arm_to_target(g, &now, target);
        else
            g->status = arm_follow(g, &now, twist);
        g->next = g->tick + g->ticks;
        g->heeds_target = target != NULL;
        if (target) g->heard = *target;
        for (i = 0; i < 6; i++) g->heard_twist[i] = twist ? twist[i] : 0.0;
    }
    g->tick++;
    for (i = 0; i < ARM_N; i++) {
        g->history[0][i] = g->history[1][i];
        g->history[1][i] = g->history[2][i];
    }
    arm_plan_at(&g->plan[g->taken], (double)g->tick * g->dt, g->history[2]);
    for (i = 0; i < ARM_N; i++) q_next[i] = g->history[2][i];
    if (!usable) return ARM_BAD_NUMBER;
    if (g->status == ARM_OK && !arm_heeded(g, target, twist)) return ARM_SLOWED;
    return g->status;
}
