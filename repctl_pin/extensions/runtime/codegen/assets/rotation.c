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

/* Divide an angle in [0, pi] by its sine, given the square of the sine and the cosine, or both times a length; the
 * quotient is then divided by that length. Below 30 degrees it is a polynomial in the square. */
static double arm_angle_per_sine(double square, double cosine)
{
    const double length = square + cosine * cosine, z = square / length, zz = z * z;
    if (cosine > 0.0 && z < 0.25)
        return (1.0 + z * (0.1666666666666662 + z * 0.07500000000033673
            + zz * (0.044642857088426066 + z * 0.03038194816511533
            + zz * (0.02237202440896431 + z * 0.017355665746480328
            + zz * (0.013925165918699349 + z * 0.011907635629904689
            + zz * (0.007654232351924293 + z * 0.01646436717361212
            + zz * (-0.011449691653251649 + z * 0.02866440773010254))))))) / sqrt(length);
    return atan2(sqrt(square), cosine) / sqrt(square);
}

