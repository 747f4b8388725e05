/* Coordinates of a straight line: those of the cell, y + phi. A box is convex in y. */
static const double arm_course_lower[ARM_M] = @least;
static const double arm_course_upper[ARM_M] = @greatest;

@placed
static void arm_shifted(const arm_course *start, const double phi[6], arm_course *course)
{
    int i;
    for (i = 0; i < 6; i++) course->y[i] = start->y[i] + phi[i];
    arm_cell_placed(course->y, &course->place);
}

/* Convert coordinates and their derivatives to the velocity there, and its derivative. */
static void arm_course_rates(const double phi[6], const double first[6], const double second[6], double twist[6],
                             double rate[6])
{
    int i;
    (void)phi;
    for (i = 0; i < 6; i++) {
        twist[i] = first[i];
        rate[i] = second[i];
    }
}

/* Evaluate a course at q; the course gives its coordinates up to full turns. */
static void arm_course_at(const double q[ARM_N], arm_course *course)
{
    const double turn = 6.283185307179586;
    double y[ARM_M], u[arm_cell_k];
    int i;
    arm_place(q, course->place.p, course->place.R);
    arm_cell_coordinates(&course->place, y, u);
    for (i = 0; i < ARM_M; i++) course->y[i] = y[i] - turn * rint((y[i] - course->y[i]) / turn);
}

enum { arm_bounded = 1 }; /* whether the coordinates have bounds */

static void arm_course_begin(const double q[ARM_N], arm_course *course)
{
    double y[ARM_M], u[arm_cell_k];
    int i;
    arm_place(q, course->place.p, course->place.R);
    arm_cell_coordinates(&course->place, y, u);
    for (i = 0; i < 6; i++) course->y[i] = i < ARM_M ? y[i] : 0.0;
}

/* Convert a task velocity to one in the cell's coordinates, 0 in those of width 0. */
static void arm_velocity_along(const arm_course *course, const double rate[ARM_M], double way[6])
{
    int a, i;
    for (i = 0; i < 6; i++) way[i] = 0.0;
    for (i = 0; i < ARM_M; i++) {
        double d[ARM_M] = {0.0};
        if (!(arm_course_lower[i] < arm_course_upper[i])) continue;
        d[i] = 1.0;
        arm_cell_rates(course->place.R, course->y, d);
        for (a = 0; a < ARM_M; a++) way[i] += d[a] * rate[a];
    }
}

/* Compute the displacement to a target, or to the nearest placement in the cell. */
static void arm_way(const arm_course *course, const arm_pose *target, double way[6])
{
    double y[ARM_M], u[arm_cell_k];
    int i;
    arm_cell_coordinates(target, y, u);
    for (i = 0; i < 6; i++) way[i] = 0.0;
    for (i = 0; i < ARM_M; i++) {
        double nearest = y[i] < arm_course_upper[i] ? y[i] : arm_course_upper[i];
        if (!(nearest > arm_course_lower[i])) nearest = arm_course_lower[i];
        way[i] = nearest - course->y[i];
    }
}

/* Tell whether a target is in the cell. */
static int arm_holds(const arm_pose *target)
{
    double y[ARM_M], u[arm_cell_k];
    arm_cell_coordinates(target, y, u);
    return arm_cell_inside(y, u);
}

/* Evaluate the task velocity per unit of each coordinate, E (m, 6). */
static void arm_task_rates(const arm_course *course, double E[ARM_M * 6])
{
    int a, b;
    for (b = 0; b < 6; b++) {
        double twist[6] = {0.0}, rate[ARM_M] = {0.0};
        if (b < ARM_M) arm_cell_twist(course->y, b, twist);
        arm_add_rate(course->place.R, twist, 1.0, rate);
        for (a = 0; a < ARM_M; a++) E[a * 6 + b] = rate[a];
    }
}
