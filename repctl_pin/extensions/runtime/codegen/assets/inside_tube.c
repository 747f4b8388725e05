arm_status arm_inside(const double q[ARM_N])
{
    static const double radius[ARM_N] = @radius;
    static const double sample[@count][ARM_N] = {
@samples};
    int a, i;
    if (!arm_finite(q, ARM_N)) return ARM_BAD_NUMBER;
    for (a = 0; a < @count; a++) {
        for (i = 0; i < ARM_N; i++)
            if (!(fabs(q[i] - sample[a][i]) / radius[i] <= 1.0 + 1e-9)) break;
        if (i == ARM_N) return ARM_OK;
    }
    return ARM_OUTSIDE;
}
