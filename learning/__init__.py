"""The learner of sections 2 to 4: control problems, value networks, continuous TD(lambda), runs and their evaluation.

Read :mod:`~swimmer_mj.learning.continuous_td` beside equation 2; :mod:`~swimmer_mj.learning.fused` is the same
algorithm, compiled. Nothing is imported here.
"""
