/* e = p* - p, the coordinates of the task. */
static const int arm_rows[ARM_M] = @rows;

static void arm_error(const double p[3], const double R[9], const arm_pose *target, double e[ARM_M])
{
    int i;
    (void)R;
    for (i = 0; i < ARM_M; i++) e[i] = target->p[arm_rows[i]] - p[arm_rows[i]];
}

static void arm_add_rate(const double R[9], const double twist[6], double dt, double b[ARM_M])
{
    int i;
    (void)R;
    for (i = 0; i < ARM_M; i++) b[i] += dt * twist[arm_rows[i]];
}
