/* Test whether the joints are within their limits, up to rounding. */
static int arm_within_limits(const double q[ARM_N])
{
    static const double lower[ARM_N] = @lower;
    static const double upper[ARM_N] = @upper;
    double joint[ARM_N];
    int i;
@joints
    for (i = 0; i < ARM_N; i++)
        if (!(joint[i] >= lower[i] - 1e-9 && joint[i] <= upper[i] + 1e-9)) return 0;
    return 1;
}
