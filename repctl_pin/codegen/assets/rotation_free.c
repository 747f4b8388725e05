/* The task leaves the rotation free: any will do. */
static int arm_rotation(const double R[9])
{
    (void)R;
    return 1;
}

