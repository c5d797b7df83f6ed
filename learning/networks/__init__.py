"""Value networks V_w and their greedy policies."""
