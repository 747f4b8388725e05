/* d <- d E^-1: convert a gradient in the cell's coordinates to one in the task velocity; for the tool axis
 * E = R_xy^T J_l(w) R0_xy with the left Jacobian J_l of SO(3), w = R0_xy (y_3, y_4). */
static void arm_cell_rates(const double R[9], const double y[ARM_M], double d[ARM_M])
{
    const double *R0 = arm_cell_middle.R, square = y[3] * y[3] + y[4] * y[4], angle = sqrt(square);
    const double a = angle < 1e-4 ? 0.5 - square / 24.0 : (1.0 - cos(angle)) / square;
    const double b = angle < 1e-4 ? 1.0 / 6.0 - square / 120.0 : (angle - sin(angle)) / (square * angle);
    double w[3], B[2][2], det, first, second;
    int i, k;
    for (i = 0; i < 3; i++) w[i] = R0[3 * i] * y[3] + R0[3 * i + 1] * y[4];
    for (k = 0; k < 2; k++) {
        const double x[3] = {R0[k], R0[3 + k], R0[6 + k]};
        double s[3], t[3];
        s[0] = w[1] * x[2] - w[2] * x[1];
        s[1] = w[2] * x[0] - w[0] * x[2];
        s[2] = w[0] * x[1] - w[1] * x[0];
        t[0] = w[1] * s[2] - w[2] * s[1];
        t[1] = w[2] * s[0] - w[0] * s[2];
        t[2] = w[0] * s[1] - w[1] * s[0];
        B[0][k] = B[1][k] = 0.0;
        for (i = 0; i < 3; i++) {
            const double turned = x[i] + a * s[i] + b * t[i];
            B[0][k] += R[3 * i] * turned;
            B[1][k] += R[3 * i + 1] * turned;
        }
    }
    det = B[0][0] * B[1][1] - B[0][1] * B[1][0];
    first = (d[3] * B[1][1] - d[4] * B[1][0]) / det;
    second = (d[4] * B[0][0] - d[3] * B[0][1]) / det;
    d[3] = first;
    d[4] = second;
}
