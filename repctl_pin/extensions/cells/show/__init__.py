"""Maps, figures and the page of a cell."""
