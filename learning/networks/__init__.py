"""Value networks V_w, their compiled evaluation, and what acts by them: the greedy policy."""
