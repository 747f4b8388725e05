
/* ---- the inverse kinematic function of the cell ------------------------------------------------------------- */

arm_status arm_F(const arm_pose *target, const double *leaf, double q[ARM_N])
{
    static const double lower[ARM_N] = @lower;
    static const double upper[ARM_N] = @upper;
    double A[ARM_N][ARM_N], y[ARM_M], u[@k], T[@count], both[ARM_N * (1 + ARM_R)] = {0.0};
    double x[ARM_N], b[ARM_N], p[3], R[9];
    int swap[ARM_N], a, i, j, turn;

    if (!arm_rotation(target->R)) return ARM_BAD_NUMBER;
    arm_cell_coordinates(target, y, u);
    if (!arm_finite(y, ARM_M) || (leaf && !arm_finite(leaf, ARM_R))) return ARM_BAD_NUMBER;
    if (!arm_cell_inside(y, u)) return ARM_OUTSIDE;

    T[0] = 1.0;
    for (a = 1; a < @count; a++) T[a] = T[arm_cell_parent[a]] * u[arm_cell_factor[a]];
    for (a = 0; a < @count; a++)
        for (i = 0; i < arm_cell_width; i++) both[i] += T[a] * arm_cell_weight[a][i];
@turned    for (i = 0; i < ARM_N; i++) {
        x[i] = both[(1 + ARM_R) * i];
        for (j = 0; leaf && j < ARM_R; j++) x[i] += leaf[j] * both[(1 + ARM_R) * i + 1 + j];
    }
    for (turn = 0; turn < 12; turn++) { /* Newton's method on [x - f(q); c - n_ref^T (q - q_ref)] */
        double size = 0.0, share;
        arm_chain(x, p, R, A);
        arm_error(p, R, target, b);
        for (j = 0; j < ARM_R; j++) {
            b[ARM_M + j] = leaf ? leaf[j] : 0.0;
            for (i = 0; i < ARM_N; i++) {
                A[ARM_M + j][i] = both[(1 + ARM_R) * i + 1 + j];
                b[ARM_M + j] += A[ARM_M + j][i] * (both[(1 + ARM_R) * i] - x[i]);
            }
        }
        if (!arm_factor(A, swap)) return ARM_OUTSIDE;
        arm_solve(A, swap, b);
        if (!arm_finite(b, ARM_N)) return ARM_OUTSIDE;
        for (i = 0; i < ARM_N; i++)
            if (fabs(b[i]) > size) size = fabs(b[i]);
        share = size <= 0.3 ? 1.0 : 0.3 / size;
        for (i = 0; i < ARM_N; i++) x[i] += share * b[i];
        if (size < 1e-6) {
            for (i = 0; i < ARM_N; i++)
                if (x[i] < lower[i] || x[i] > upper[i]) return ARM_OUTSIDE;
            for (i = 0; i < ARM_N; i++) q[i] = x[i];
            return ARM_OK;
        }
    }
    return ARM_OUTSIDE;
}
