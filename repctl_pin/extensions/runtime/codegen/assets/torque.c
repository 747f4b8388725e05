
/* ---- torques ------------------------------------------------------------------------------------------------- */

@types
@library
/* ---- torques: functions of the header -------------------------------------------------------------------------- */

void arm_torque_defaults(arm_gains *gains)
{
    static const double stiffness[ARM_M] = @stiffness;
    int i;
    for (i = 0; i < ARM_M; i++) gains->stiffness[i] = stiffness[i];
    gains->damping = 1.0;
    gains->leaf_frequency = 20.0;
    gains->leaf_damping = 1.0;
    gains->observer_rate = 200.0;
    for (i = 0; i < ARM_N; i++) gains->observer_limit[i] = 5.0;
}

arm_status arm_torque(const double q[ARM_N], const double qdot[ARM_N], const double inertia[ARM_N * ARM_N],
                      const double bias[ARM_N], const arm_pose *target, const double *twist,
                      const double leaf[ARM_R], const arm_gains *gains, double dt, double *observer,
                      double tau[ARM_N])
{
    arm_gains usual;
    if (!gains) arm_torque_defaults(&usual);
    return (arm_status)joint_torques(arm_tables, q, qdot, inertia, bias, target, twist, leaf, gains ? gains : &usual,
                                     dt, observer, tau);
}
