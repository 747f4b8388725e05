
@structs
/* Fill gains with the defaults of Python's LeafImpedance. */
void arm_torque_defaults(arm_gains *gains);

/*
 * Compute the joint torques of a spring and damper at the end effector and of the return to the leaf, decoupled:
 * tau = M J_V^-1 ([xddot; hddot - d] - J_V' qdot) + bias.
 *
 * M         joint-space inertia at q, symmetric, n x n: libfranka's model.mass(), kg m^2
 * bias      torques that the robot does not compensate itself: libfranka's model.coriolis(); for other robots with
 *           gravity
 * target    placement of the target of each frame now
 * twist     velocity (v, omega) of each target, base axes, m/s and rad/s; NULL: 0
 * leaf      c, from arm_leaf() at the start
 * gains     NULL: those of arm_torque_defaults()
 * dt        time step, s, observer_rate dt at most 1; not used without an observer
 * observer  state of the disturbance observer, which the call updates: zeros at the start; NULL: no observer
 */
arm_status arm_torque(const double q[ARM_N], const double qdot[ARM_N], const double M[ARM_N * ARM_N],
                      const double bias[ARM_N], const arm_pose *target, const double *twist,
                      const double leaf[ARM_R], const arm_gains *gains, double dt, double *observer,
                      double tau[ARM_N]);
