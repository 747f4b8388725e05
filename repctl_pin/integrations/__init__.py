"""Integration with other packages; each module requires its own extra."""
