
int arm_call_F(arm_call *call, int given);
long arm_call_functions(long count, const double *p, const double *R, const double *leaf, double *Q);

/* bits of given: 2 leaf */
int arm_call_F(arm_call *call, int given)
{
    const arm_pose target = arm_call_target(call);
    return (int)arm_F(&target, given & 2 ? call->leaf : NULL, call->result);
}

/* Compute q at every placement p, R on one leaf; return the number before the first failure. */
long arm_call_functions(long count, const double *p, const double *R, const double *leaf, double *Q)
{
    long a;
    for (a = 0; a < count; a++) {
        arm_pose target;
        int i;
        for (i = 0; i < 3; i++) target.p[i] = p[3 * a + i];
        for (i = 0; i < 9; i++) target.R[i] = R[9 * a + i];
        if (arm_F(&target, leaf, Q + a * ARM_N) != ARM_OK) break;
    }
    return a;
}
