static const int arm_cell_places[@places] = @rows;

/* Convert the angular coordinates to a rotation vector, base axes. */
static void arm_cell_vector(const double y[6], double w[3])
{
    int i;
@vector}

/* Compute the placement at coordinates y. */
static void arm_cell_placed(const double y[6], arm_pose *place)
{
    double w[3];
    int i;
    for (i = 0; i < 3; i++) place->p[i] = arm_cell_middle.p[i];
    for (i = 0; i < @places; i++) place->p[arm_cell_places[i]] += y[i];
    arm_cell_vector(y, w);
    arm_turned(w, arm_cell_middle.R, place->R);
}

/* Evaluate the twist of the frame per unit of coordinate b. */
static void arm_cell_twist(const double y[6], int b, double twist[6])
{
    const double zero[3] = {0.0};
    double w[3], axis[3], unit[6] = {0.0}, spare[3];
    int i;
    unit[b] = 1.0;
    arm_cell_vector(y, w);
    arm_cell_vector(unit, axis);
    arm_angular(w, axis, zero, twist + 3, spare);
    for (i = 0; i < 3; i++) twist[i] = 0.0;
    if (b < @places) twist[arm_cell_places[b]] = 1.0;
}
