"""Chart of a cell: reference configurations and directions, as polynomials of its coordinates."""
