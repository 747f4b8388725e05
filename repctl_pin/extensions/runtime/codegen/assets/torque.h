
/* Gains of arm_torque(), filled by arm_torque_defaults(). */
typedef struct {
    double stiffness[ARM_M];      /* K of the end effector, one per row of J, N/m and Nm/rad, above 0 */
    double damping;               /* damping ratio of the end effector; 1 is critical */
    double leaf_frequency;        /* natural frequency of the return to the leaf, rad/s */
    double leaf_damping;          /* damping ratio of the return to the leaf */
    double observer_rate;         /* rate at which the observer follows a disturbance of the leaf, 1/s */
    double observer_limit[ARM_N]; /* maximum torque of the observer in each joint, Nm or N, above 0 */
} arm_gains;

/* Fill gains with the defaults of Python's LeafImpedance. */
void arm_torque_defaults(arm_gains *gains);

/*
 * Compute the joint torques of a spring and damper at the end effector and of the return to the leaf, decoupled:
 * tau = M J_V^-1 ([xddot; hddot - d] - J_V' qdot) + bias.
 *
 * M         joint-space inertia at q, symmetric, n x n: libfranka's model.mass(), kg m^2
 * bias      torques that the robot does not compensate itself: libfranka's model.coriolis(); for other robots with
 *           gravity
 * target    placement of the target now
 * twist     velocity (v, omega) of the target, base axes, m/s and rad/s; NULL: 0
 * leaf      c, from arm_leaf() at the start
 * gains     NULL: those of arm_torque_defaults()
 * dt        time step, s, observer_rate dt at most 1; not used without an observer
 * observer  state of the disturbance observer, which the call updates: zeros at the start; NULL: no observer
 */
arm_status arm_torque(const double q[ARM_N], const double qdot[ARM_N], const double M[ARM_N * ARM_N],
                      const double bias[ARM_N], const arm_pose *target, const double *twist,
                      const double leaf[ARM_R], const arm_gains *gains, double dt, double *observer,
                      double tau[ARM_N]);
