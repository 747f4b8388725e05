
/* ---- the inverse kinematic function of the cell ------------------------------------------------------------- */

@library

arm_status arm_F(const arm_pose *target, const double *leaf, double q[ARM_N])
{
    return (arm_status)find_configuration(arm_tables, arm_tables->part->chart, @keep, target, leaf, q);
}

long arm_F_batch(long count, const arm_pose *targets, const double *leaf, double *q)
{
    int status[AT_ONCE];
    long a;
    int l;
    if (leaf && !all_finite(leaf, ARM_R)) return 0;
    for (a = 0; a < count; a += AT_ONCE) {
        const int few = count - a < AT_ONCE ? (int)(count - a) : AT_ONCE;
        find_configurations(arm_tables, arm_tables->part->chart, @keep, few, targets + a, leaf, 0, q + a * ARM_N, status);
        for (l = 0; l < few; l++)
            if (status[l] != OK) return a + l;
    }
    return count;
}
