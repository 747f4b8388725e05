/* Potentials of a cell function: h = n_ref(u)^T (q - q_ref(u)), with u the frame's coordinates in the cell; q_ref and
 * n_ref are polynomials in u. */
enum { arm_cell_k = @k, arm_cell_count = @count, arm_cell_width = ARM_N * (1 + ARM_R) };

static const double arm_cell_widths[ARM_M] = @widths; /* 0: fixed coordinate */
static const int arm_cell_moved[@k] = @moved;
static const double arm_cell_scale[@k] = @scale; /* 1 / width */
static const unsigned short arm_cell_parent[@count] = @parents; /* T[a] = T[parent[a]] u[factor[a]] */
static const unsigned short arm_cell_factor[@count] = @factors;
static const double arm_cell_weight[@count][ARM_N * (1 + ARM_R)] = { /* q_ref and n_ref, joint by joint */
@weights};

@coordinates
@rates

static void arm_potential_@number(const double q[ARM_N], double h[ARM_R], double V[][ARM_N])
{
    double J[ARM_M][ARM_N], y[ARM_M], u[@k], T[@count], dT[@count][@k], both[ARM_N * (1 + ARM_R)] = {0.0};
    double slopes[ARM_N * (1 + ARM_R)][@k], d[ARM_M], away;
    arm_pose pose;
    int a, i, j, k;
    arm_chain(q, pose.p, pose.R, J);
    arm_cell_coordinates(&pose, y, u);
    T[0] = 1.0;
    for (k = 0; k < @k; k++) dT[0][k] = 0.0;
    for (a = 1; a < @count; a++) {
        const int parent = arm_cell_parent[a], factor = arm_cell_factor[a];
        T[a] = T[parent] * u[factor];
        for (k = 0; k < @k; k++) dT[a][k] = dT[parent][k] * u[factor];
        dT[a][factor] += T[parent];
    }
    for (i = 0; i < arm_cell_width; i++)
        for (k = 0; k < @k; k++) slopes[i][k] = 0.0;
    for (a = 0; a < @count; a++)
        for (i = 0; i < arm_cell_width; i++) {
            both[i] += T[a] * arm_cell_weight[a][i];
            for (k = 0; k < @k; k++) slopes[i][k] += dT[a][k] * arm_cell_weight[a][i];
        }
@shift    for (j = 0; j < ARM_R; j++) {
        for (a = 0; a < ARM_M; a++) d[a] = 0.0;
        for (i = 0; i < ARM_N; i++) {
            const int at = (1 + ARM_R) * i, n = at + 1 + j;
            away = q[i] - both[at];
            h[j] += both[n] * away;
            V[j][i] += both[n];
            for (k = 0; k < @k; k++) {
                const int moved = arm_cell_moved[k];
                d[moved] += (slopes[n][k] * away - both[n] * slopes[at][k]) / arm_cell_widths[moved];
            }
        }
@along        arm_cell_rates(pose.R, y, d);
        for (i = 0; i < ARM_N; i++)
            for (a = 0; a < ARM_M; a++) V[j][i] += d[a] * J[a][i];
    }
}
