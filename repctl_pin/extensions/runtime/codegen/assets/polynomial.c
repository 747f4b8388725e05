/* Polynomials made homogeneous by z_0 = 1: w_i = dh/dz_i is a sum over monomials u, and h = sum w_i z_i / @degree. */
static void arm_potential_@number(const double q[ARM_N], double h[ARM_R], double V[][ARM_N])
{
    static const int joint[@k] = @joints;
    static const double center[@k] = @center;
    static const double scale[@k] = @scale;
    static const unsigned short parent[@count] = @parents; /* u[a] = u[parent[a]] z[factor[a]] */
    static const unsigned short factor[@count] = @factors;
    static const double weight[@count][@width] = {
@weights};
    double d[@k], z[@k], u[@count], w[@width] = {0.0};
    int a, i, j;
    for (j = 0; j < @k; j++) {
        d[j] = q[joint[j]] - center[j];
        z[j] = d[j] * scale[j];
    }
    u[0] = 1.0;
    for (a = 1; a < @count; a++) u[a] = u[parent[a]] * z[factor[a]];
    for (a = 0; a < @count; a++)
        for (j = 0; j < @width; j++) w[j] += u[a] * weight[a][j];
    for (i = 0; i < ARM_R; i++) {
        double value = w[(@k + 1) * i];
        for (j = 0; j < @k; j++) {
            value += w[(@k + 1) * i + 1 + j] * d[j];
            V[i][joint[j]] += w[(@k + 1) * i + 1 + j];
        }
        h[i] += value / @degree;
    }
}
