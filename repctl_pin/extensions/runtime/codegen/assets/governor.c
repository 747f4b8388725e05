
/* ---- governor ------------------------------------------------------------------------------------------------ */

@types
@library
/* ---- governor: functions of the header ------------------------------------------------------------------------ */

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

arm_status arm_governor_start(arm_governor *governor, const double q[ARM_N], double dt, const arm_limits *limits)
{
    return (arm_status)govern_from(arm_tables, governor, q, dt, limits);
}

arm_status arm_governor_step(arm_governor *governor, const arm_pose *target, const double *twist, double q_next[ARM_N])
{
    return (arm_status)govern(arm_tables, governor, target, twist, q_next);
}
