arm_status arm_inside(const double q[ARM_N])
{
    static const double center[ARM_N] = @center;
    static const double half[ARM_N] = @half;
    int i;
    if (!arm_finite(q, ARM_N)) return ARM_BAD_NUMBER;
    for (i = 0; i < ARM_N; i++)
        if (!(fabs(q[i] - center[i]) / half[i] <= 1.0 + 1e-9)) return ARM_OUTSIDE;
    return ARM_OK;
}
