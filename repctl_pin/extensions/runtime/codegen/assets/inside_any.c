arm_status arm_inside(const double q[ARM_N])
{
    return arm_finite(q, ARM_N) ? ARM_OK : ARM_BAD_NUMBER;
}
