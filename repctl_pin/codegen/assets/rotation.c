/* Test whether R, row by row, is a rotation to 1e-6: two orthonormal rows, the third their cross product. */
static int arm_rotation(const double R[9])
{
    int i;
    double away[6];
    away[0] = R[0] * R[0] + R[1] * R[1] + R[2] * R[2] - 1.0;
    away[1] = R[3] * R[3] + R[4] * R[4] + R[5] * R[5] - 1.0;
    away[2] = R[0] * R[3] + R[1] * R[4] + R[2] * R[5];
    away[3] = R[1] * R[5] - R[2] * R[4] - R[6];
    away[4] = R[2] * R[3] - R[0] * R[5] - R[7];
    away[5] = R[0] * R[4] - R[1] * R[3] - R[8];
    for (i = 0; i < 6; i++)
        if (!(fabs(away[i]) < 1e-6)) return 0;
    return 1;
}

