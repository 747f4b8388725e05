"""Evaluation of a function q = F(x) over its cell: margins, failures, what the arm reaches."""
