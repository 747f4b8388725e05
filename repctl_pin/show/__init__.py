"""Pictures of results: takes results, computes nothing."""
