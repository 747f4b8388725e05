"""Complete problems, and studies that compare all strategies on one problem."""
