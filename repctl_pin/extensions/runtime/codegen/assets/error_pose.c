/* Compute the rotation vector of a matrix M, orthonormalised first: angle times axis, rad. */
static void arm_log(double M[9], double w[3])
{
    double x[3], y[3], z[3], a[3], length = 0.0, width = 0.0, square, cosine;
    int i;
    for (i = 0; i < 3; i++) {
        length += M[3 * i] * M[3 * i];
        width += M[3 * i + 1] * M[3 * i + 1];
    }
    length = 1.0 / sqrt(length);
    width = 1.0 / sqrt(width);
    for (i = 0; i < 3; i++) {
        x[i] = M[3 * i] * length;
        y[i] = M[3 * i + 1] * width;
    }
    z[0] = x[1] * y[2] - x[2] * y[1];
    z[1] = x[2] * y[0] - x[0] * y[2];
    z[2] = x[0] * y[1] - x[1] * y[0];
    x[0] = y[1] * z[2] - y[2] * z[1];
    x[1] = y[2] * z[0] - y[0] * z[2];
    x[2] = y[0] * z[1] - y[1] * z[0];
    a[0] = (y[2] - z[1]) / 2.0; /* axis times sine */
    a[1] = (z[0] - x[2]) / 2.0;
    a[2] = (x[1] - y[0]) / 2.0;
    square = a[0] * a[0] + a[1] * a[1] + a[2] * a[2];
    cosine = (x[0] + y[1] + z[2] - 1.0) / 2.0;
    if (!(cosine < -0.9)) {
        const double scale = arm_angle_per_sine(square, cosine);
        for (i = 0; i < 3; i++) w[i] = a[i] * scale;
    } else { /* near half a turn: the axis from the symmetric part, its sign from the other */
        const double angle = atan2(sqrt(square), cosine), d[3] = {x[0], y[1], z[2]};
        const int k = d[0] >= d[1] ? (d[0] >= d[2] ? 0 : 2) : (d[1] >= d[2] ? 1 : 2);
        double axis[3], size;
        axis[0] = k == 0 ? 2.0 * (d[0] - cosine) : k == 1 ? x[1] + y[0] : x[2] + z[0];
        axis[1] = k == 1 ? 2.0 * (d[1] - cosine) : k == 0 ? x[1] + y[0] : y[2] + z[1];
        axis[2] = k == 2 ? 2.0 * (d[2] - cosine) : k == 0 ? x[2] + z[0] : y[2] + z[1];
        size = sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]);
        size *= a[k] < 0.0 ? -1.0 : 1.0;
        for (i = 0; i < 3; i++) w[i] = axis[i] * angle / size;
    }
}

/* e = (p* - p, log(R* R^T)). */
static void arm_error(const double p[3], const double R[9], const arm_pose *target, double e[ARM_M])
{
    double M[9];
    int i, k;
    for (i = 0; i < 3; i++) {
        e[i] = target->p[i] - p[i];
        for (k = 0; k < 3; k++)
            M[3 * i + k] = target->R[3 * i] * R[3 * k] + target->R[3 * i + 1] * R[3 * k + 1]
                           + target->R[3 * i + 2] * R[3 * k + 2];
    }
    arm_log(M, e + 3);
}

static void arm_add_rate(const double R[9], const double twist[6], double dt, double b[ARM_M])
{
    int i;
    (void)R;
    for (i = 0; i < 6; i++) b[i] += dt * twist[i];
}
