
/* Coefficients of q_ref and n_ref, one column for each entry, in the order of Horner's rule. */
@tables
/* Compute q_ref and n_ref, joint by joint: polynomials in u, by Horner's rule in one variable inside another. */
static void arm_chart(const double u[@k], double both[arm_cell_width][1])
{
    int i;
@sums
}
