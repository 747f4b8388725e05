/* @about */
#ifndef ARM_H
#define ARM_H

#ifdef __cplusplus
extern "C" {
#endif

#define ARM_N @n /* joints */
#define ARM_M @m /* task coordinates */
#define ARM_R @r /* degree of redundancy, potentials */

typedef enum {
    ARM_OK = 0,
    ARM_SINGULAR = 1,   /* J_V = [J; V^T] is singular there */
    ARM_BAD_NUMBER = 2, /* an argument is not finite, or outside what it may be, or R is no rotation to 1e-6 */
    ARM_OUTSIDE = 3     /* q lies outside the region of the design, or the next q beyond the joints' limits */
} arm_status;

/* Where a frame is, in the base frame: p in m, R row by row. */
typedef struct {
    double p[3];
    double R[9];
} arm_pose;

/* How a step is taken; arm_defaults() fills one. */
typedef struct {
    double gain;         /* K, 1/s, K dt from 0 to 2; ARM_WHOLE_STEP: K = 1 / dt, a whole Newton step */
    double limit[ARM_N]; /* joint speeds not to be exceeded, rad/s or m/s; HUGE_VAL: none */
    double damping;      /* greatest lambda near singularities, in the units of J; 0: ARM_SINGULAR there */
    int stay_inside;     /* 1: ARM_OUTSIDE as Python's outside="raise"; 0: go on, as its outside="ignore" */
} arm_options;

#define ARM_WHOLE_STEP (-1.0)

/* What a step did. */
typedef struct {
    double damping; /* lambda that was used; 0 where the step is exact */
    double slowed;  /* by what factor a limit scaled the step; 1 where none did */
} arm_report;

/*
 * Every function leaves its outputs untouched unless it returns ARM_OK, allocates nothing, keeps nothing, and
 * may be called from any number of threads. An output may be the same array as an input.
 */

/* Place the frame at joints q. */
arm_status arm_placement(const double q[ARM_N], arm_pose *pose);

/* J of xdot = J qdot, row by row. */
arm_status arm_jacobian(const double q[ARM_N], double J[ARM_M * ARM_N]);

/* G of qdot = G xdot with J G = 1 and V^T G = 0, row by row. */
arm_status arm_inverse(const double q[ARM_N], double G[ARM_N * ARM_M]);

/* c = h(q): the leaf that q lies on, and that every motion from there stays on. */
arm_status arm_leaf(const double q[ARM_N], double c[ARM_R]);

/* Joint velocity qdot for a task velocity xdot: J qdot = xdot and V^T qdot = 0. */
arm_status arm_velocity(const double q[ARM_N], const double xdot[ARM_M], double qdot[ARM_N]);

/* Whether q lies in the region that the control was designed for: ARM_OK (which is 0) or ARM_OUTSIDE. */
arm_status arm_inside(const double q[ARM_N]);

/* Whole Newton steps, no speed limits, no damping, @stays. */
void arm_defaults(arm_options *options);

/*
 * The next q of a control loop: q + J_V^-1 (dt [xdot; 0] + K dt [x - f(q); c - h(q)]).
 *
 * target   where the frame should be; without a twist: at the end of the step; with a twist: now
 * dt       time of the step, s
 * twist    velocity (v, omega) of the target, base axes, m/s and rad/s; NULL: none
 * leaf     c, from arm_leaf() at the start; NULL: h is held, but not brought back
 * options  NULL: those of arm_defaults()
 * report   NULL: none wanted
 */
arm_status arm_step(const double q[ARM_N], const arm_pose *target, double dt, const double *twist,
                    const double *leaf, const arm_options *options, arm_report *report, double q_next[ARM_N]);
@function
#ifdef __cplusplus
}
#endif

#endif
