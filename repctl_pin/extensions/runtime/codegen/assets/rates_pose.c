/* d <- d E^-1: convert a gradient in the cell's coordinates to one in the task velocity; E has the left Jacobian of
 * SO(3) for its rotations. */
static void arm_cell_rates(const double R[9], const double y[ARM_M], double d[ARM_M])
{
    const double *w = y + 3, square = w[0] * w[0] + w[1] * w[1] + w[2] * w[2], angle = sqrt(square);
    const double c = angle < 1e-3 ? 1.0 / 12.0 + square / 720.0
                                  : 1.0 / square - (1.0 + cos(angle)) / (2.0 * angle * sin(angle));
    double r[3], s[3];
    int i;
    (void)R;
    for (i = 0; i < 3; i++) r[i] = d[3 + i];
    s[0] = r[1] * w[2] - r[2] * w[1];
    s[1] = r[2] * w[0] - r[0] * w[2];
    s[2] = r[0] * w[1] - r[1] * w[0];
    d[3] = r[0] - s[0] / 2.0 + c * (s[1] * w[2] - s[2] * w[1]);
    d[4] = r[1] - s[1] / 2.0 + c * (s[2] * w[0] - s[0] * w[2]);
    d[5] = r[2] - s[2] / 2.0 + c * (s[0] * w[1] - s[1] * w[0]);
}
