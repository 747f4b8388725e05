
/* ---- functions for Python, with one block of memory to avoid conversions ------------------------------------- */

typedef struct {
    double q[ARM_N];
    double xdot[ARM_M];
    double target[16]; /* [R p; 0 1] row by row */
    double twist[6];
    double leaf[ARM_R];
    double dt;
    arm_report report;
    double result[ARM_N];
    double gain;
    double limit[ARM_N];
    double damping;
} arm_call;

int arm_call_velocity(arm_call *call);
int arm_call_step(arm_call *call, int given);
long arm_call_inverses(long count, const double *Q, double *G);
long arm_call_velocities(long count, const double *Q, const double *Xdot, double *Qdot);

int arm_call_velocity(arm_call *call)
{
    return (int)arm_velocity(call->q, call->xdot, call->result);
}

static arm_pose arm_call_target(const arm_call *call)
{
    arm_pose target;
    int i, k;
    for (i = 0; i < 3; i++) {
        for (k = 0; k < 3; k++) target.R[3 * i + k] = call->target[4 * i + k];
        target.p[i] = call->target[4 * i + 3];
    }
    return target;
}

/* bits of given: 1 twist, 2 leaf, 4 limits and damping */
int arm_call_step(arm_call *call, int given)
{
    const arm_pose target = arm_call_target(call);
    arm_options options;
    int i;
    arm_defaults(&options);
    options.gain = call->gain;
    options.stay_inside = 0; /* Python checks the region */
    if (given & 4) {
        for (i = 0; i < ARM_N; i++) options.limit[i] = call->limit[i];
        options.damping = call->damping;
    }
    return (int)arm_step(call->q, &target, call->dt, given & 1 ? call->twist : NULL, given & 2 ? call->leaf : NULL,
                         &options, &call->report, call->result);
}

/* Compute G at every row of Q, and qdot; return the number of rows before the first singular one. */
long arm_call_inverses(long count, const double *Q, double *G)
{
    long a;
    for (a = 0; a < count; a++)
        if (arm_inverse(Q + a * ARM_N, G + a * ARM_N * ARM_M) != ARM_OK) break;
    return a;
}

long arm_call_velocities(long count, const double *Q, const double *Xdot, double *Qdot)
{
    long a;
    for (a = 0; a < count; a++)
        if (arm_velocity(Q + a * ARM_N, Xdot + a * ARM_M, Qdot + a * ARM_N) != ARM_OK) break;
    return a;
}
