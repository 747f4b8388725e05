/* The cell's coordinates are the task's own. */
static void arm_section_rates(const double R[9], const double y[ARM_M], double d[ARM_M])
{
    (void)R;
    (void)y;
    (void)d;
}
