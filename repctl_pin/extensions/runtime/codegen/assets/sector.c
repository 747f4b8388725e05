/* Cylindrical coordinates y: radius, angle and height around an axis, two tilts and the spin of the tool. The
 * orientation turns with the angle. A symmetric coordinate is not among the u; the function is linear in it. */
static const double arm_cell_origin[3] = @origin;
static const double arm_cell_basis[9] = @basis; /* rows: outward, around and along the axis, at the middle */
static const double arm_cell_turn[9] = @turn;   /* basis times the middle's rotation */
static const double arm_cell_at[2] = @at;       /* radius and height of the middle */
static const double arm_cell_bounds[ARM_M] = @bounds;

@functions/* Compute the coordinates y relative to the cell's middle, m and rad, and the scaled coordinates u. */
static void arm_cell_coordinates(const arm_pose *pose, double y[ARM_M], double u[@k])
{
    const double *B = arm_cell_basis;
    double d[3], x[3], all[6] = {0.0}, radius;
    int i, k;
    for (i = 0; i < 3; i++) d[i] = pose->p[i] - arm_cell_origin[i];
    for (i = 0; i < 3; i++) x[i] = B[3 * i] * d[0] + B[3 * i + 1] * d[1] + B[3 * i + 2] * d[2];
    radius = sqrt(x[0] * x[0] + x[1] * x[1]);
    all[0] = radius - arm_cell_at[0];
    all[1] = atan2(x[1], x[0]);
    all[2] = x[2] - arm_cell_at[1];
@tilts    for (k = 0; k < ARM_M; k++) y[k] = all[k];
    for (k = 0; k < @k; k++) u[k] = y[arm_cell_moved[k]] * arm_cell_scale[k];
}

/* Test whether coordinates are in the cell; fixed coordinates to 1e-6 m or rad. */
static int arm_cell_inside(const double y[ARM_M], const double u[@k])
{
    int i;
    (void)u;
    for (i = 0; i < ARM_M; i++)
        if (!(fabs(y[i]) <= arm_cell_bounds[i])) return 0;
    return 1;
}

/* d <- d E^-1: convert a gradient in the cell's coordinates to one in the task velocity. */
static void arm_cell_rates(const double R[9], const double y[ARM_M], double d[ARM_M])
{
    static const int rows[@places] = @rows;
    const double *B = arm_cell_basis, *C = arm_cell_turn;
    const double c = cos(y[1]), s = sin(y[1]), radius = arm_cell_at[0] + y[0];
    double all[6] = {0.0}, S[9], V[9], A[2][3], g[3] = {0.0}, v[3], round_about;
    int i, j, k;
    for (i = 0; i < ARM_M; i++) all[i] = d[i];
    round_about = all[1];
    if (ARM_M > 3) {
        double t[3] = {0.0}, turn[6] = {0.0}, square, angle, a, b, det;
        for (i = 0; i < ARM_M; i++) turn[i] = y[i];
        t[0] = turn[3];
        t[1] = turn[4];
        square = t[0] * t[0] + t[1] * t[1];
        angle = sqrt(square);
        a = angle < 1e-4 ? 0.5 - square / 24.0 : (1.0 - cos(angle)) / square;
        b = angle < 1e-4 ? 1.0 / 6.0 - square / 120.0 : (angle - sin(angle)) / (square * angle);
        for (j = 0; j < 3; j++) { /* V = R_a(angle) R_0 */
            S[j] = c * C[j] - s * C[3 + j];
            S[3 + j] = s * C[j] + c * C[3 + j];
            S[6 + j] = C[6 + j];
        }
        for (i = 0; i < 3; i++)
            for (j = 0; j < 3; j++) V[3 * i + j] = B[i] * S[j] + B[3 + i] * S[3 + j] + B[6 + i] * S[6 + j];
        for (k = 0; k < 2; k++) { /* A: the frame's own angular velocity per tilt, V^T then R */
            const double e[2] = {k == 0 ? 1.0 : 0.0, k == 1 ? 1.0 : 0.0};
            double z = t[0] * e[1] - t[1] * e[0], h[3], base[3];
            h[0] = e[0] + b * t[1] * z;
            h[1] = e[1] - b * t[0] * z;
            h[2] = a * z;
            for (i = 0; i < 3; i++) base[i] = V[3 * i] * h[0] + V[3 * i + 1] * h[1] + V[3 * i + 2] * h[2];
            for (i = 0; i < 3; i++) A[k][i] = R[i] * base[0] + R[3 + i] * base[1] + R[6 + i] * base[2];
        }
        g[2] = all[5];
        det = A[0][0] * A[1][1] - A[0][1] * A[1][0];
        g[0] = ((all[3] - A[0][2] * g[2]) * A[1][1] - (all[4] - A[1][2] * g[2]) * A[0][1]) / det;
        g[1] = ((all[4] - A[1][2] * g[2]) * A[0][0] - (all[3] - A[0][2] * g[2]) * A[1][0]) / det;
        for (i = 0; i < 3; i++)
            round_about -= (R[i] * B[6] + R[3 + i] * B[7] + R[6 + i] * B[8]) * g[i];
    }
    for (i = 0; i < 3; i++)
        v[i] = all[0] * (c * B[i] + s * B[3 + i]) + round_about / radius * (c * B[3 + i] - s * B[i])
               + all[2] * B[6 + i];
    for (i = 0; i < @places; i++) d[i] = v[rows[i]];
@angular}
