/* V = R_a(angle) R_0: the middle's rotation, turned with the angle. */
static void arm_cell_turned(double angle, double V[9])
{
    const double *B = arm_cell_basis, *C = arm_cell_turn, c = cos(angle), s = sin(angle);
    double S[9];
    int i, j;
    for (j = 0; j < 3; j++) {
        S[j] = c * C[j] - s * C[3 + j];
        S[3 + j] = s * C[j] + c * C[3 + j];
        S[6 + j] = C[6 + j];
    }
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) V[3 * i + j] = B[i] * S[j] + B[3 + i] * S[3 + j] + B[6 + i] * S[6 + j];
}

/* Compute the placement at coordinates y. */
static void arm_cell_placed(const double y[6], arm_pose *place)
{
    const double *B = arm_cell_basis, radius = arm_cell_at[0] + y[0], height = arm_cell_at[1] + y[2];
    const double x[3] = {radius * cos(y[1]), radius * sin(y[1]), height}, t[3] = {y[3], y[4], 0.0};
    const double spin[9] = {cos(y[5]), -sin(y[5]), 0.0, sin(y[5]), cos(y[5]), 0.0, 0.0, 0.0, 1.0};
    double T[9], V[9];
    int i, j;
    for (i = 0; i < 3; i++) place->p[i] = arm_cell_origin[i] + B[i] * x[0] + B[3 + i] * x[1] + B[6 + i] * x[2];
    arm_turned(t, spin, T);
    arm_cell_turned(y[1], V);
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++)
            place->R[3 * i + j] = V[3 * i] * T[j] + V[3 * i + 1] * T[3 + j] + V[3 * i + 2] * T[6 + j];
}

/* Evaluate the twist of the frame per unit of coordinate b. */
static void arm_cell_twist(const double y[6], int b, double twist[6])
{
    const double *B = arm_cell_basis, c = cos(y[1]), s = sin(y[1]), radius = arm_cell_at[0] + y[0];
    const double t[3] = {y[3], y[4], 0.0}, zero[3] = {0.0};
    double unit[3] = {0.0}, turn[3], spare[3], V[9];
    int i;
    for (i = 0; i < 6; i++) twist[i] = 0.0;
    for (i = 0; i < 3; i++) {
        if (b == 0) twist[i] = c * B[i] + s * B[3 + i];
        if (b == 1) {
            twist[i] = radius * (c * B[3 + i] - s * B[i]);
            twist[3 + i] = B[6 + i];
        }
        if (b == 2) twist[i] = B[6 + i];
    }
    if (b < 3) return;
    if (b < 5) { /* J_l(t) times a unit vector */
        unit[b - 3] = 1.0;
        arm_angular(t, unit, zero, turn, spare);
    } else { /* exp(t) times the tool's z axis */
        const double eye[9] = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};
        double T[9];
        arm_turned(t, eye, T);
        for (i = 0; i < 3; i++) turn[i] = T[3 * i + 2];
    }
    arm_cell_turned(y[1], V);
    for (i = 0; i < 3; i++) twist[3 + i] = V[3 * i] * turn[0] + V[3 * i + 1] * turn[1] + V[3 * i + 2] * turn[2];
}
