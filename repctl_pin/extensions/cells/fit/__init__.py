"""The design of a function q = F(x): its cost, penalties and Gauss–Newton descent."""
