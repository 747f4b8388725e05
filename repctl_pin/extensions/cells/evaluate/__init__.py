"""Evaluation of a function q = F(x) over its cell: margins, failures and reach of the arm."""
