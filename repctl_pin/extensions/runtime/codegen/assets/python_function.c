
int arm_call_F(arm_call *call, int given);
void arm_call_functions(long count, const double *X, const double *leaf, int stride, double *Q);

/* bits of given: 2 leaf */
int arm_call_F(arm_call *call, int given)
{
    const arm_pose target = arm_call_target(call);
    return (int)arm_F(&target, given & 2 ? call->leaf : NULL, call->result);
}

/* Read a target, a homogeneous matrix row by row; its last row is tested to 1e-6. */
static int arm_call_read(const double X[16], arm_pose *target)
{
    int i, k;
    for (i = 0; i < 3; i++) {
        target->p[i] = X[4 * i + 3];
        for (k = 0; k < 3; k++) target->R[3 * i + k] = X[4 * i + k];
    }
    for (i = 12; i < 16; i++)
        if (!(fabs(X[i] - (i == 15)) <= 1e-6)) return 0;
    return 1;
}

/* Compute q at every target; rows without q are NaN. The leaf of the next target is stride numbers further. */
void arm_call_functions(long count, const double *X, const double *leaf, int stride, double *Q)
{
    long a;
    int i, l;
    for (a = 0; a < count; a += @lanes) {
        const int few = count - a < @lanes ? (int)(count - a) : @lanes;
        arm_pose targets[@lanes];
        arm_status status[@lanes];
        int read[@lanes];
        for (l = 0; l < few; l++) read[l] = arm_call_read(X + 16 * (a + l), targets + l);
        arm_F_lanes(few, targets, leaf + a * stride, stride, Q + a * ARM_N, status);
        for (l = 0; l < few; l++)
            for (i = 0; i < ARM_N && !(read[l] && status[l] == ARM_OK); i++) Q[(a + l) * ARM_N + i] = HUGE_VAL - HUGE_VAL;
    }
}
