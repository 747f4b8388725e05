"""Code generation: repeatable inverses and functions of cells as C, exported or compiled."""
