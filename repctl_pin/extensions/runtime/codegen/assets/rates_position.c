/* The cell's coordinates are the task coordinates. */
static void arm_cell_rates(const double R[9], const double y[ARM_M], double d[ARM_M])
{
    (void)R;
    (void)y;
    (void)d;
}
