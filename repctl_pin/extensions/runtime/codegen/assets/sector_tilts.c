/* Compute the two tilts and the spin y of a rotation R, after rotation by the negative angle: T = R_0^T R_a(-angle) R.
 * c and s are the cosine and the sine of the angle; no other angle is needed. */
static void arm_cell_tilts(const double R[9], double c, double s, double y[3])
{
    const double *B = arm_cell_basis, *C = arm_cell_turn;
    double S[9], T[9], square, share, length, along;
    int i, j;
    for (j = 0; j < 3; j++) {
        double x[3];
        for (i = 0; i < 3; i++) x[i] = B[3 * i] * R[j] + B[3 * i + 1] * R[3 + j] + B[3 * i + 2] * R[6 + j];
        S[j] = c * x[0] + s * x[1];
        S[3 + j] = c * x[1] - s * x[0];
        S[6 + j] = x[2];
    }
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) T[3 * i + j] = C[i] * S[j] + C[3 + i] * S[3 + j] + C[6 + i] * S[6 + j];
    square = T[2] * T[2] + T[5] * T[5]; /* of the sine of the tilt; T[8] is its cosine */
    if (!(T[8] > 0.0) && square < 1e-24) { /* upside down */
        y[0] = 3.14159265358979323846;
        y[1] = 0.0;
        y[2] = atan2(-T[3], T[0]);
        return;
    }
    share = arm_angle_per_sine(square, T[8]);
    y[0] = -T[5] * share;
    y[1] = T[2] * share;
    /* the first column of exp(-tilt) T is (cos spin, sin spin, 0); both are multiplied by length */
    length = sqrt(square + T[8] * T[8]);
    along = (T[5] * T[0] - T[2] * T[3]) * (T[8] > 0.0 ? 1.0 / (length + T[8]) : (length - T[8]) / square);
    y[2] = atan2(T[3] * T[8] - T[5] * T[6] - T[2] * along, T[0] * T[8] - T[2] * T[6] + T[5] * along);
}

