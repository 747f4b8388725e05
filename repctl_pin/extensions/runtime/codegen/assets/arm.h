/* @about */
#ifndef ARM_H
#define ARM_H

#ifdef __cplusplus
extern "C" {
#endif

#define ARM_N @n /* joints */
#define ARM_M @m /* task coordinates */
#define ARM_R @r /* degree of redundancy, potentials */
#define ARM_FRAMES @frames /* frames: placements, targets and twists are arrays, one entry per frame */

typedef enum {
    ARM_OK = 0,
    ARM_SINGULAR = 1,   /* J_V = [J; V^T] is singular at q */
    ARM_BAD_NUMBER = 2, /* an argument is not finite or out of range, or R is not a rotation to 1e-6 */
    ARM_OUTSIDE = 3,    /* q is outside the design region, or the next q outside the joint limits */
    ARM_SLOWED = 4,     /* of a governor: on the way, as fast as the limits allow */
    ARM_LIMIT = 5,      /* of a governor: a joint limit is ahead */
    ARM_RECOVERING = 7  /* of a governor: on the way back from beyond a joint limit */
} arm_status;

/* Placement of a frame in the base frame: p in m, R row by row. */
typedef struct {
    double p[3];
    double R[9];
} arm_pose;

/* Options of arm_step(), filled by arm_defaults(). */
typedef struct {
    double gain;         /* K, 1/s, K dt from 0 to 2; ARM_WHOLE_STEP: K = 1 / dt, a full Newton step */
    double limit[ARM_N]; /* maximum joint speeds, rad/s or m/s; HUGE_VAL: no limit */
    double damping;      /* maximum lambda near singularities, in the units of J; 0: return ARM_SINGULAR */
    int stay_inside;     /* 1: return ARM_OUTSIDE, as Python's outside="raise"; 0: as outside="ignore" */
} arm_options;

#define ARM_WHOLE_STEP (-1.0)

/* Report of arm_step(). */
typedef struct {
    double damping; /* lambda used; 0 if the step is exact */
    double slowed;  /* factor by which a speed limit scaled the step; 1 if none did */
} arm_report;

/*
 * Functions write their outputs only if they return ARM_OK. They allocate no memory, keep no state, and can be
 * called from any number of threads. An output can be the same array as an input.
 */

/* Compute the placement of each frame at q. */
arm_status arm_placement(const double q[ARM_N], arm_pose pose[ARM_FRAMES]);

/* Compute J of xdot = J qdot, row by row. */
arm_status arm_jacobian(const double q[ARM_N], double J[ARM_M * ARM_N]);

/* Compute G of qdot = G xdot with J G = I and V^T G = 0, row by row. */
arm_status arm_inverse(const double q[ARM_N], double G[ARM_N * ARM_M]);

/* Compute c = h(q), the level of the leaf that contains q and every motion from q. ARM_BAD_NUMBER: it overflows. */
arm_status arm_leaf(const double q[ARM_N], double c[ARM_R]);

/* Compute the joint velocity qdot for a task velocity xdot: J qdot = xdot and V^T qdot = 0. */
arm_status arm_velocity(const double q[ARM_N], const double xdot[ARM_M], double qdot[ARM_N]);

/* Test whether q is in the design region: ARM_OK (which is 0) or ARM_OUTSIDE. */
arm_status arm_inside(const double q[ARM_N]);

/* Fill options with the defaults: full Newton steps, no speed limits, no damping, @stays. */
void arm_defaults(arm_options *options);

/*
 * Compute the next q of a control loop: q + J_V^-1 (dt [xdot; 0] + K dt [x - f(q); c - h(q)]).
 *
 * target   placement of the target of each frame: without a twist at the end of the step, with a twist at its start
 * dt       duration of the step, s
 * twist    velocity (v, omega) of each target, base axes, m/s and rad/s; NULL: none
 * leaf     c, from arm_leaf() at the start; NULL: h is kept constant without feedback
 * options  NULL: the options of arm_defaults()
 * report   NULL: no report
 */
arm_status arm_step(const double q[ARM_N], const arm_pose *target, double dt, const double *twist,
                    const double *leaf, const arm_options *options, arm_report *report, double q_next[ARM_N]);
@torque@function@governor@closing
#ifdef __cplusplus
}
#endif

#endif
