"""The choice of a cell, and of the configuration in its middle."""
