arm_status arm_inside(const double q[ARM_N])
{
    static const double center[ARM_N] = @center;
    static const double half[ARM_N] = @half;
    static const int axis[@count] = @axes;
    static const double position[@count] = @position;
    static const double width[@count] = @width;
    double p[3], R[9];
    int i;
    if (!arm_finite(q, ARM_N)) return ARM_BAD_NUMBER;
    for (i = 0; i < ARM_N; i++)
        if (!(fabs(q[i] - center[i]) / half[i] <= 1.0 + 1e-9)) return ARM_OUTSIDE;
    arm_place(q, p, R);
    for (i = 0; i < @count; i++)
        if (!(fabs(p[axis[i]] - position[i]) / width[i] <= 1.0 + 1e-9)) return ARM_OUTSIDE;
    return ARM_OK;
}
