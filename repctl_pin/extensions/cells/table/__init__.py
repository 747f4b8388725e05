"""Where an arm can work: the best place for a box, and the largest sector around the arm."""
