/* Coordinates of a straight line: p + phi_v, exp(phi_w) R; the velocity is the twist of the frame. */
static void arm_shifted(const arm_course *start, const double phi[6], arm_course *course)
{
    int i;
    for (i = 0; i < 3; i++) course->place.p[i] = start->place.p[i] + phi[i];
    arm_turned(phi + 3, start->place.R, course->place.R);
    for (i = 0; i < 6; i++) course->y[i] = 0.0;
}

/* Convert coordinates and their derivatives to the velocity there, and its derivative. */
static void arm_course_rates(const double phi[6], const double first[6], const double second[6], double twist[6],
                             double rate[6])
{
    int i;
    arm_angular(phi + 3, first + 3, second + 3, twist + 3, rate + 3);
    for (i = 0; i < 3; i++) {
        twist[i] = first[i];
        rate[i] = second[i];
    }
}

static void arm_course_at(const double q[ARM_N], arm_course *course)
{
    arm_place(q, course->place.p, course->place.R);
}

enum { arm_bounded = 0 }; /* whether the coordinates have bounds */

static void arm_course_begin(const double q[ARM_N], arm_course *course)
{
    int i;
    arm_place(q, course->place.p, course->place.R);
    for (i = 0; i < 6; i++) course->y[i] = 0.0;
}

/* Convert a task velocity to a twist, 0 in what is not part of the task. */
static void arm_velocity_along(const arm_course *course, const double rate[ARM_M], double twist[6])
{
    const double *R = course->place.R;
    int i;
    for (i = 0; i < 6; i++) twist[i] = 0.0;
@lift
}

/* Compute the displacement to a target. */
static void arm_way(const arm_course *course, const arm_pose *target, double way[6])
{
    double e[ARM_M];
    arm_error(course->place.p, course->place.R, target, e);
    arm_velocity_along(course, e, way);
}

/* Tell whether a target is inside the range of the coordinates: there is none. */
static int arm_holds(const arm_pose *target)
{
    (void)target;
    return 1;
}

/* Evaluate the task velocity per unit of each coordinate, E (m, 6). */
static void arm_task_rates(const arm_course *course, double E[ARM_M * 6])
{
    int a, b;
    for (b = 0; b < 6; b++) {
        double unit[6] = {0.0}, rate[ARM_M] = {0.0};
        unit[b] = 1.0;
        arm_add_rate(course->place.R, unit, 1.0, rate);
        for (a = 0; a < ARM_M; a++) E[a * 6 + b] = rate[a];
    }
}
