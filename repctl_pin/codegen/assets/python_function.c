
int arm_call_F(arm_call *call, int given);
long arm_call_functions(long count, const double *targets, const double *leaf, double *Q);

/* bits of given: 2 leaf */
int arm_call_F(arm_call *call, int given)
{
    const arm_pose target = arm_call_target(call);
    return (int)arm_F(&target, given & 2 ? call->leaf : NULL, call->result);
}

/* Compute q at every placement, (p, R) row by row, on one leaf; return the number before the first failure. */
long arm_call_functions(long count, const double *targets, const double *leaf, double *Q)
{
    return arm_F_batch(count, (const arm_pose *)targets, leaf, Q);
}
