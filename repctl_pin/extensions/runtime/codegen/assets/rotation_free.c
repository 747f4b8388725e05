/* The task does not depend on the rotation. */
static int arm_rotation(const double R[9])
{
    (void)R;
    return 1;
}

